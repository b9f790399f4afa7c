//! Recordings: the trials of a set, their samples in m/s² at the models' sample rate, verdicts on them, and recordings
//! of a free hand.
//!
//! Invariant: inputs are files, or samples that a program holds; outputs are samples and verdicts. Nothing here fits a
//! model.

mod axes;
mod clock;
mod csv_file;
mod defects;
pub mod freehand;
mod held;
mod joined;
mod kind;
mod load;
mod lvm;
mod numbers;
mod order;
pub mod pattern;
mod polled;
mod rate;
mod resample;
mod riff;
mod set;
mod snap;
mod source;
mod step;
mod time_text;
mod time_unit;
pub mod triage;
mod trial;
mod uneven;
mod unit;
mod wav;

pub use defects::{Defects, Gap, Hold, Spike, Timing, Truncation};
pub use held::HeldSamples;
pub use kind::Kind;
pub use load::{held_table, read, read_at};
pub use rate::{MAX_CHANNELS, MAX_FRAMES, RATES_HZ, SampleRate, most_frames};
pub use resample::resample;
pub use set::{Assumed, LIST_COLUMNS, MOST_TRIALS, RecordingSet, TRIALS_FILE, is_list, list_command};
pub use snap::{Nominal, Rule, Snap, Spread, clear_grid, grid_by_gaps, nominal};
pub use source::{Account, Cut, Samples, Source};
pub(crate) use time_unit::TimeColumn;
pub use time_unit::TimeUnit;
pub use trial::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, TRIAL_DURATION_S, Trial, texture_fault};
pub use unit::scale;
pub use unit::{GRAVITY_M_S2, GRAVITY_TOLERANCE, Unscaled};
