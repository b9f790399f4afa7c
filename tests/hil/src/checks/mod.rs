//! The tests, one module per subject. Each takes the bench and adds its lines to the report. A failure of the link or
//! of the device ends the subject, not the run.

pub mod cycles;
pub mod endurance;
pub mod faults;
pub mod playing;
pub mod self_test;
pub mod upload;
