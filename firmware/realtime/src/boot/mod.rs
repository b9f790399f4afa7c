//! From reset to running: watchdog, memory layout, clocks, silicon, supply, interrupt priorities, and the cause of the
//! reset.
//!
//! Invariant: no file here imports another module of the crate. The watchdog counts and the output is at mid-scale
//! before any Rust code runs.

pub mod clock;
pub mod critical;
pub mod priority;
pub mod protection;
pub mod silicon;
pub mod startup;
