//! Recording sets: which trials there are (`set`), and their samples as accelerations at the models' rate (`load`).

mod csv_file;
mod load;
mod resample;
mod set;
mod wav;

pub use load::{Cut, Samples, Source, read};
pub use resample::resample;
pub(crate) use set::csv_error;
pub use set::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, RecordingSet, TRIALS_FILE, Trial};

/// Sample rate of the models and of the stylus, Hz.
pub const MODEL_RATE_HZ: u32 = 5000;

/// How much of a trial is used unless it says otherwise, s; the paper's figure.
pub const TRIAL_DURATION_S: f64 = 2.0;

/// Most channels of a recording: three axes.
pub const MAX_CHANNELS: usize = 3;
