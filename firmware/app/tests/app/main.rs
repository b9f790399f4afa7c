//! Tests of the application on the host, through its public interface, on flash that can lose power.
#![expect(clippy::result_large_err, reason = "errors carry their reason as text")]

#[path = "../attack/budget.rs"]
mod budget;
mod double_faults;
mod inputs;
mod lease;
mod lines;
mod player;
mod power_cut;
mod proposals;
mod recorder;
mod requests;
mod rest;
mod safety;
mod self_test;
mod settings;
mod slots;
mod start;
mod upload;
