//! Tests of the application on the host, through its public interface, on flash that can lose power.
//!
//! `boots`, `interleavings`, `hosts`, `probe`, `recorder`, `settings::histories`, `slot_faults` and `safety` choose
//! their cases at random from a seed: few in an ordinary run, more with other seeds while `cargo tasks attack` runs.
#![expect(clippy::result_large_err, reason = "errors carry their reason as text")]

mod boots;
mod budget;
mod hosts;
mod inputs;
mod interleavings;
mod lines;
mod probe;
mod recorder;
mod requests;
mod rest;
mod safety;
mod self_test;
mod settings;
mod slot_faults;
mod slots;
mod speed;
mod start;
mod update;
mod upload;
