//! From reset to running: watchdog, memory layout, clocks, silicon, supply, interrupt priorities, and the cause of the
//! reset.
//!
//! Invariant: no file here imports another room, and before any Rust code runs the watchdog counts
//! and the output is at mid-scale.

pub mod clock;
pub mod critical;
pub mod priority;
pub mod protection;
pub mod silicon;
pub mod startup;
