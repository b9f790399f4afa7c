//! The tick: one sample, 5000 times per second. It reads the inputs, computes the sample of the block that is played,
//! applies the safety stages, and writes the output.
//!
//! Invariant: no lock, log, flash access, allocation, wait, or path that depends on the data; code in ITCM, data in
//! DTCM.

pub mod alive;
mod handler;
pub mod inputs;
pub mod output;
pub mod raising;
pub mod supply;

#[cfg(feature = "fault-injection")]
pub use handler::age;
pub use handler::{configure, heat, is_at_rest, now, play, set_heat, set_muted, snapshot, start, stop, take_range};
