//! From reset to running: memory layout, clocks, interrupt priorities, and the cause of the reset.
//!
//! Invariant: no file here imports another room, and the output is at mid-scale before any Rust code runs.

pub mod clock;
pub mod critical;
pub mod priority;
pub mod protection;
pub mod reset;
pub mod startup;
