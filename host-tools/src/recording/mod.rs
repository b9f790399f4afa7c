//! Recordings: which trials a set has, their samples in m/s² at the models' rate, what is wrong with them, and the pieces
//! of a free hand's recording.
//!
//! Invariant: files in, samples and verdicts out. Nothing here fits a model.

mod clipping;
mod csv_file;
pub mod freehand;
mod load;
mod resample;
mod samples;
mod set;
mod source;
pub mod triage;
mod wav;

pub use load::read;
pub use resample::resample;
pub use samples::Samples;
pub(crate) use set::csv_error;
pub use set::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, RecordingSet, TRIALS_FILE, Trial};
pub use source::{Cut, Source};

/// Length of a trial that is used unless it says otherwise, s; the paper's figure.
pub const TRIAL_DURATION_S: f64 = 2.0;

/// Most channels of a recording: three axes.
pub const MAX_CHANNELS: usize = 3;
