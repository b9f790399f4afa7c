//! The part of a trial that is compared with others.

use super::copies::Sketch;
use super::verdict::{Kind, Verdict};

/// A trial, as far as it is compared with others.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// Name of the trial's texture.
    pub texture: &'a str,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Third-octave bands that the recording knows: centre, Hz, ascending, and level, dB.
    pub bands_db: &'a [(f64, f64)],
    /// True at rest or without contact, where slow motion is all that there is to record.
    pub is_idle: bool,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// A line at a mains frequency, Hz.
    pub mains_line_hz: Option<f64>,
    /// Sketch of the trial's signal.
    pub sketch: &'a Sketch,
    /// Verdicts on the trial so far.
    pub verdicts: &'a [Verdict],
}

impl Compared<'_> {
    pub(super) fn is_silent(&self) -> bool {
        self.verdicts
            .iter()
            .any(|verdict| verdict.kind() == Kind::Silent)
    }
}
