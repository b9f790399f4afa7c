//! The properties of a trial that are compared with those of others.

use super::copies::Sketch;
use super::hum::MainsLine;
use super::verdict::{Kind, Verdict};

/// The properties of a trial that are compared with those of others.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// Name of the trial's texture.
    pub texture: &'a str,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Third-octave bands in which the recording is valid: centre, Hz, ascending, and level, dB.
    pub bands_db: &'a [(f64, f64)],
    /// True at rest or without contact, where there is only slow motion to record.
    pub is_idle: bool,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// False if the samples are integers of unknown acceleration.
    pub has_scale: bool,
    /// Lines at mains frequencies.
    pub mains_lines: &'a [MainsLine],
    /// Sketch of the trial's signal.
    pub sketch: &'a Sketch,
    /// Verdicts on the trial so far.
    pub verdicts: &'a [Verdict],
}

impl Compared<'_> {
    pub(super) fn is_silent(&self) -> bool {
        self.verdicts.iter().any(|verdict| verdict.kind() == Kind::Silent)
    }
}
