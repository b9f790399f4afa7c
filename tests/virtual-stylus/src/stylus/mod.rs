//! A run of an image, which a test stops and inspects.
//!
//! The emulator runs on a thread of its own from one given instant to the next. Between two of them it waits, and runs
//! closures with access to the board and its memory.

mod emulation;
mod options;
mod report;
mod run;

pub use emulation::PowerCut;
pub use options::{Options, PESSIMISTIC_INSTRUCTIONS_PER_SECOND};
pub use report::{Reset, ResetCause, RunReport};
pub use run::VirtualStylus;
