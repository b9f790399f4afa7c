//! A run of an image, stopped and looked at as a test likes.
//!
//! The emulator runs on a thread of its own and is handed instants to reach; between two of them it waits, and closures
//! can be run beside it with the board and its memory in hand.

mod emulation;
mod options;
mod report;
mod run;

pub use emulation::PowerCut;
pub use options::{Options, PESSIMISTIC_INSTRUCTIONS_PER_SECOND};
pub use report::{Report, Reset, ResetCause};
pub use run::VirtualStylus;
