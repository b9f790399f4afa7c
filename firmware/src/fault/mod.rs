//! How the program ends: fault handlers, the watchdog and the guard of the stack, and the records of the reasons.
//!
//! Invariant: the first act of every handler is to put the output to mid-scale, which works whatever state the program
//! is in.

pub mod handlers;
pub mod heat;
pub mod record;
pub mod report;
pub mod stack;
pub mod watchdog;
