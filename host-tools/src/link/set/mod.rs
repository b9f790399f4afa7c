//! A recording set that grows by one trial at a time, in a folder that a fit reads.
//!
//! A trial is a WAV file of three channels of 32-bit floats. A sample of 1 is half the converter's range on the axis
//! with the largest scale, so that one `scale_m_s2` turns all three channels into m/s². The trial's line in
//! `trials.csv` is written after its file, so that an interruption at any time leaves a valid set.

mod folder;
mod planned_trial;

pub use folder::Folder;
pub use planned_trial::PlannedTrial;
