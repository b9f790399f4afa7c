//! The two wires to the host, and the requests that come over them.
//!
//! Invariants:
//! - Requests run in tasks. Interrupt handlers move bytes and count faults of the line.
//! - A frame that cannot be sent or decoded is counted. A transfer cut off by the end of a USB session is not.
//! - No host stops the tick. No host stops the other link, except by a change of settings, which masks the tasks'
//!   interrupts while flash is written or erased, and which is refused while something is played.

pub mod otg;
pub mod outlet;
pub mod requests;
pub mod serial;
pub mod storage;
pub mod usb;
pub mod wire;
