//! Limits: each function compares the values of one measurement with them, and says what to do.
//!
//! A limit's source stands beside it. DS12110 is the part's datasheet, RM0433 its manual, ES0392 its errata. A limit
//! without a source is a choice, wide enough for a good device and narrow enough for the fault that it names.

mod chip;
mod clocks;
mod flash;
mod memory;
mod option_bytes;
mod output;
mod run;
mod sensors;

pub use chip::chip;
pub use clocks::clocks;
pub use flash::flash;
pub use memory::memory;
pub use option_bytes::option_bytes;
pub use output::{output, rest};
pub use run::{Traffic, state, traffic};
pub use sensors::{at_rest, moved};
