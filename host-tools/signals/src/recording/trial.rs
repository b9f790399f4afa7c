//! One recording of a recording set.

use std::path::PathBuf;
use std::sync::Arc;

use model_format::Provenance;
use model_format::limits::MAX_NAME_BYTES;

use super::held::HeldSamples;
use super::time_unit::TimeUnit;

/// Length of a trial of the paper's protocol, s.
pub const TRIAL_DURATION_S: f64 = 2.0;

/// Speed that is assumed for a recording whose speed is not known, mm/s.
pub const NOMINAL_SPEED_MM_S: f64 = 100.0;

/// Force that is assumed for a recording whose force is not known, N.
pub const NOMINAL_FORCE_N: f64 = 1.0;

/// Returns what is wrong with a texture's name, according to the rules of lists and libraries; `None` if it is valid.
pub fn texture_fault(name: &str) -> Option<String> {
    if name.trim().is_empty() {
        Some("must not be empty".into())
    } else if name.contains(char::is_control) {
        Some("must not have a control character, such as the end of a line".into())
    } else if name.len() > MAX_NAME_BYTES {
        Some(format!(
            "has {} bytes, and must have at most {MAX_NAME_BYTES}",
            name.len()
        ))
    } else {
        None
    }
}

/// One recording of one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The file, or the name of samples in memory.
    pub file: PathBuf,
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Tangential speed, mm/s, before speeds of its texture were moved to nominal values; `None` if none were moved.
    pub measured_speed_mm_s: Option<f64>,
    /// Normal force, N.
    pub force_n: f64,
    /// Acceleration of a sample of 1, the full scale of a WAV file's integers, m/s². If not given, the scale in the
    /// file's header is used, or 1.
    pub scale_m_s2: Option<f64>,
    /// Start of the used part, s.
    pub start_s: f64,
    /// Longest duration of the used part, s; if not given, the part extends to the end of the file.
    pub duration_s: Option<f64>,
    /// Sample rate of the file, Hz, which counts before that of its header or its times.
    pub sample_rate_hz: Option<f64>,
    /// Unit of a CSV file's times; if not given, it is determined from the column's name or from the steps.
    pub time_unit: Option<TimeUnit>,
    /// True if a CSV file's samples are evenly spaced, regardless of their times; `None` if nothing states it.
    pub has_even_times: Option<bool>,
    /// Origin of the samples: recorded or simulated.
    pub provenance: Provenance,
    /// Samples in memory, which are used instead of the file.
    pub held: Option<Arc<HeldSamples>>,
}

impl Trial {
    /// Returns the trial that consists of the whole recording `file` of `texture` at a speed, mm/s, and a force, N. Its
    /// samples are in the unit of the file's header, or in m/s².
    pub fn of(file: impl Into<PathBuf>, texture: impl Into<String>, speed_mm_s: f64, force_n: f64) -> Self {
        Self {
            file: file.into(),
            texture: texture.into(),
            speed_mm_s,
            measured_speed_mm_s: None,
            force_n,
            scale_m_s2: None,
            start_s: 0.0,
            duration_s: None,
            sample_rate_hz: None,
            time_unit: None,
            has_even_times: None,
            provenance: Provenance::Recorded,
            held: None,
        }
    }

    /// Speed at which spectral lines are computed, mm/s: the measured speed, if the trial has one.
    pub fn line_speed_mm_s(&self) -> f64 {
        self.measured_speed_mm_s.unwrap_or(self.speed_mm_s)
    }

    /// Returns whether both speed and force are above zero. Otherwise the stylus is silent.
    pub fn is_in_motion_and_contact(&self) -> bool {
        self.speed_mm_s > 0.0 && self.force_n > 0.0
    }

    /// Returns whether the trial contains only the noise of the rig in motion, without contact with a surface.
    pub fn is_of_the_rig(&self) -> bool {
        self.speed_mm_s > 0.0 && self.force_n <= 0.0
    }
}
