//! Recordings: the trials of a set, their samples in m/s² at the models' sample rate, verdicts on them, and the steady
//! segments of a free hand's recording.
//!
//! Invariant: files in, samples and verdicts out. Nothing here fits a model.

mod csv_file;
mod csv_table;
mod defects;
pub mod freehand;
mod list;
mod load;
mod rate;
mod resample;
mod riff;
mod samples;
mod set;
mod source;
pub mod triage;
mod trial;
mod wav;

pub(crate) use csv_table::{TABLE, csv_error, csv_header, csv_table};
pub use defects::{Defects, Hold, Spike, Truncation};
pub use load::read;
pub use rate::{MAX_FRAMES, RATES_HZ, rate_fault};
pub use resample::resample;
pub use samples::Samples;
pub use set::{RecordingSet, TRIALS_FILE};
pub use source::{Cut, MAX_CHANNELS, Source};
pub use trial::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, TRIAL_DURATION_S, Trial};
