//! Arguments that several commands share: recordings, and numbers with a range.

use std::path::PathBuf;

use host_tools::playing::motion::MotionPath;
use host_tools::recording::{Assumed, NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, RecordingSet};
use host_tools::support::error::Result;
use host_tools::support::hand::{force_fault, speed_fault};

use crate::cli::output::warn;

/// Recordings, with the values that their files may lack.
#[derive(clap::Args)]
pub struct Recordings {
    /// Folder with trials.csv, such a list, or WAV or CSV recordings (each becomes a texture named like the file)
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Duration of a trial whose list gives no duration_s, in seconds [default: to its end]
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,
    /// Sample rate of CSV recordings without a time column, in hertz
    #[arg(long, value_name = "HZ", value_parser = positive)]
    sample_rate: Option<f64>,
    /// Acceleration of a sample of 1 (the full scale of integers) of trials whose list gives no scale_m_s2, in m/s²
    /// [default: 1]
    #[arg(long, value_name = "M_S2", value_parser = positive)]
    scale: Option<f64>,
    /// Tangential speed of recordings given without a list, in mm/s
    #[arg(long, value_name = "MM_S", value_parser = recorded_speed, default_value_t = NOMINAL_SPEED_MM_S)]
    speed: f64,
    /// Normal force of recordings given without a list, in newtons
    #[arg(long, value_name = "N", value_parser = recorded_force, default_value_t = NOMINAL_FORCE_N)]
    force: f64,
}

impl Recordings {
    /// The paths as they are given.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    /// Opens the set.
    ///
    /// # Errors
    /// See [`RecordingSet::open_with`].
    pub fn open(&self) -> Result<RecordingSet> {
        let assumed = Assumed {
            duration_s: self.duration,
            sample_rate_hz: self.sample_rate,
            scale_m_s2: self.scale,
            speed_mm_s: self.speed,
            force_n: self.force,
        };
        RecordingSet::open_with(&self.inputs, &assumed)
    }
}

/// Parses a finite number above zero.
pub fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be a number above zero".into()),
    }
}

/// Parses a finite number that is not negative.
pub fn not_negative(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("must be a number that is not negative".into()),
    }
}

/// Parses the speed of a motion, in mm/s; its sign is the direction.
pub fn speed(text: &str) -> std::result::Result<f64, String> {
    within(text, speed_fault)
}

/// Parses the force of a motion, in N; at or below zero there is no contact.
pub fn force(text: &str) -> std::result::Result<f64, String> {
    within(text, force_fault)
}

/// Parses the speed of a recording, in mm/s, above zero.
fn recorded_speed(text: &str) -> std::result::Result<f64, String> {
    positive(text).and_then(|_| speed(text))
}

/// Parses the force of a recording, in N, above zero.
fn recorded_force(text: &str) -> std::result::Result<f64, String> {
    positive(text).and_then(|_| force(text))
}

/// Parses the speed of a trial to be recorded, in mm/s.
#[cfg(feature = "device")]
pub fn trial_speed(text: &str) -> std::result::Result<f64, String> {
    not_negative(text).and_then(|_| speed(text))
}

/// Parses the force of a trial to be recorded, in N.
#[cfg(feature = "device")]
pub fn trial_force(text: &str) -> std::result::Result<f64, String> {
    not_negative(text).and_then(|_| force(text))
}

fn within(text: &str, fault: fn(f64) -> Option<String>) -> std::result::Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number".to_owned())?;
    fault(value).map_or(Ok(value), Err)
}

/// Parses a tolerance, as a share.
pub fn tolerance(text: &str) -> std::result::Result<f64, String> {
    /// Tolerances above would take neighbours of an ordinary grid for one.
    const MOST: f64 = 0.25;
    match positive(text) {
        Ok(share) if share <= MOST => Ok(share),
        _ => Err(format!(
            "must be a share above zero and at most {MOST}, such as 0.05"
        )),
    }
}

/// Warns of a motion along which a texture is never heard.
pub fn warn_if_silent(motion: &MotionPath) {
    if !motion.sounds() {
        warn(
            "the motion never has a speed and a force above zero together, so that nothing is heard: a force at or \
             below zero is no contact",
        );
    }
}
