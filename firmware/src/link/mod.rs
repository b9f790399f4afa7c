//! The two wires to the host, and the requests that come over them.
//!
//! Invariants:
//! - Requests run in tasks. Interrupt handlers move bytes and count faults of the line.
//! - A frame that cannot be sent or decoded is counted. A transfer cut off by the end of a USB session is not.
//! - No host stops the tick. No host stops the other link, except by what writes bank 1 of the flash, which masks the
//!   tasks' interrupts meanwhile: a change of settings or response, and a step of an update, which are refused while
//!   something is played; and the first upload after a start, which renews the record of updates.

pub mod otg;
pub mod outlet;
pub mod requests;
pub mod serial;
pub mod storage;
pub mod usb;
pub mod wire;
