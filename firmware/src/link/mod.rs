//! The two wires to the host, and the requests that come over them.
//!
//! Invariant: it runs in tasks, except for the interrupt handlers that move bytes; a frame that is lost is counted, and
//! no host, whatever it sends, keeps the other wire or the tick from going on.

pub mod counters;
pub mod otg;
pub mod outlet;
pub mod recording;
pub mod requests;
pub mod serial;
pub mod storage;
pub mod usb;
pub mod wire;
