//! Ends of the program, their reasons, and the guards that bring one about: fault handlers, watchdog, stack use.
//!
//! Invariant: the first act of every handler is to put the output to mid-scale; it works whatever state the program is
//! in.

pub mod handlers;
pub mod heat;
pub mod record;
pub mod report;
pub mod stack;
pub mod watchdog;
