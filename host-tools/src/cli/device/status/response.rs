//! The stored response in the status.

use std::time::{Duration, UNIX_EPOCH};

use model_format::link::{ResponseState, StoredResponse};
use serde::Serialize;
use stylus_support::date::utc;

/// A summary of the stored response.
#[derive(Serialize)]
pub struct Summary {
    /// Hash of the whole response.
    id: String,
    /// Day of the measurement, UTC.
    measured_on: String,
    /// Largest deviation from a flat response in the verification, dB.
    worst_db: f32,
    /// RMS of that deviation, dB.
    rms_db: f32,
    /// Settings that have changed since the measurement, in words; empty if none has.
    changed_since: String,
}

impl Summary {
    pub fn of(state: &ResponseState) -> Option<Self> {
        let StoredResponse { response, id, stale } = state.stored.as_ref()?;
        Some(Self {
            id: format!("{id:08x}"),
            measured_on: utc(UNIX_EPOCH + Duration::from_secs(response.measured_at))[..10].to_owned(),
            worst_db: response.worst_db,
            rms_db: response.rms_db,
            changed_since: stale.to_string(),
        })
    }

    pub fn line(&self) -> String {
        let Self {
            id,
            measured_on,
            worst_db,
            rms_db,
            changed_since,
        } = self;
        let stale = if changed_since.is_empty() {
            String::new()
        } else {
            format!("; STALE: {changed_since} changed since, calibrate again")
        };
        format!("{id}, measured on {measured_on}, flat within {worst_db:.1} dB ({rms_db:.1} dB RMS){stale}")
    }
}
