//! The stored response in the status.

use model_format::link::{ResponseState, StoredResponse};
use serde::Serialize;

/// The response that is stored, in short.
#[derive(Serialize)]
pub struct Summary {
    /// Hash of the whole response.
    id: String,
    /// Day of the measurement, UTC.
    measured_on: String,
    /// Largest deviation from flat of the proof, dB.
    worst_db: f32,
    /// RMS of the deviation, dB.
    rms_db: f32,
    /// Settings that have changed since, in words; empty if none has.
    changed_since: String,
}

impl Summary {
    pub fn of(state: &ResponseState) -> Option<Self> {
        let StoredResponse {
            response,
            id,
            stale,
        } = state.stored.as_ref()?;
        Some(Self {
            id: format!("{id:08x}"),
            measured_on: day(response.measured_at),
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
        format!(
            "{id}, measured on {measured_on}, flat within {worst_db:.1} dB ({rms_db:.1} dB RMS){stale}"
        )
    }
}

/// The day of a time in s since 1970-01-01, in the calendar of Howard Hinnant's `civil_from_days`.
fn day(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    format!("{:04}-{month:02}-{day:02}", year + era * 400 + next)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_gregorian_calendar() {
        let mut expected = (1970, 1, 1);
        for days in 0..100_000u64 {
            let (year, month, number) = expected;
            assert_eq!(
                day(days * 86_400 + 86_399),
                format!("{year:04}-{month:02}-{number:02}")
            );
            let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
            let last = match month {
                2 => 28 + u32::from(is_leap),
                4 | 6 | 9 | 11 => 30,
                _ => 31,
            };
            expected = match (number < last, month) {
                (true, _) => (year, month, number + 1),
                (false, 12) => (year + 1, 1, 1),
                (false, _) => (year, month + 1, 1),
            };
        }
    }
}
