//! Arguments that several commands share: recordings, and numbers with a range.

use std::path::PathBuf;

use host_tools::recording::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, RecordingSet};
use host_tools::support::error::{Error, Result};

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
    /// Tangential speed of recordings given without a list, in mm/s
    #[arg(long, value_name = "MM_S", value_parser = positive, default_value_t = NOMINAL_SPEED_MM_S)]
    speed: f64,
    /// Normal force of recordings given without a list, in newtons
    #[arg(long, value_name = "N", value_parser = positive, default_value_t = NOMINAL_FORCE_N)]
    force: f64,
}

impl Recordings {
    /// Opens the set.
    ///
    /// # Errors
    /// See [`RecordingSet::open`].
    pub fn open(&self) -> Result<RecordingSet> {
        for input in &self.inputs {
            if let Err(source) = std::fs::metadata(input) {
                return Err(Error::io("open", input)(source));
            }
        }
        let mut set = RecordingSet::open(&self.inputs)?;
        let listed = set.is_listed;
        for trial in &mut set.trials {
            trial.duration_s = trial.duration_s.or(self.duration);
            trial.sample_rate_hz = trial.sample_rate_hz.or(self.sample_rate);
            if !listed {
                trial.speed_mm_s = self.speed;
                trial.force_n = self.force;
            }
        }
        Ok(set)
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
