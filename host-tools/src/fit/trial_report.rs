//! The account of one trial that a fit gives to its user.

use serde::Serialize;

use crate::recording::triage::{Verdict, in_words};

/// The account of a trial.
#[derive(Clone, Debug, Serialize)]
pub struct TrialReport {
    /// The file.
    pub file: String,
    /// Its texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// RMS of the reduced signal, m/s².
    pub rms_m_s2: f64,
    /// Largest magnitude of an axis's mean, which was removed, m/s².
    pub mean_m_s2: f64,
    /// Share of the axes' energy that the reduced signal keeps.
    pub energy_share: f64,
    /// Duration that triage cut out of it, s.
    pub cut_s: f64,
    /// Findings of triage; none for a sound recording.
    #[serde(serialize_with = "in_words")]
    pub verdicts: Vec<Verdict>,
    /// True if the fit used it.
    pub used: bool,
}
