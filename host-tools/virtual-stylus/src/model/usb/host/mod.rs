//! The host at the other end of the cable: its root port and its controller, in virtual time.
//!
//! | What | USB 2.0 |
//! |---|---|
//! | 12 Mbit/s, frames of 1 ms after a start of frame; no transaction crosses a frame's end | 7.1.11, 8.4.3, 11.3 |
//! | A transaction lasts its packets' bits, data with the worst bit stuffing (7/6) | 5.11.3, 7.1.9 |
//! | and the longest turnaround between its packets | 7.1.18 |
//! | Control, bulk IN and bulk OUT, one transfer of a pipe at a time, pipes in turn | 5.5, 5.8, 8.5 |
//! | Data toggles at both ends; a packet that arrives twice is acknowledged and dropped | 8.6 |
//! | NAK: tried again without limit; STALL: the transfer ends | 8.4.5 |
//! | No answer or a broken one: three attempts, then the transfer ends | 10.2.6 |
//! | Reset, suspend by silence, resume; a cable that is pulled | 7.1.7 |
//!
//! Packets are broken at random, at a rate and from a seed. A token or data packet that breaks on its way to the device
//! is not answered. After a broken handshake, host and device disagree on what happened.
//!
//! While the device would refuse everything that is due, no token is sent and none is counted, because the firmware
//! cannot notice the difference. The next token is sent at the instant at which it would have been sent otherwise. Left
//! out: low and high speed, hubs, isochronous and interrupt transfers, and the host's software, which is in `usb_host`.

mod bus;
mod state;
mod transfer;

pub use state::{Host, Mishap, RESET_NS, Traffic};
pub use transfer::{Completion, PACKET_BYTES, Transfer, TransferError, TransferId};
