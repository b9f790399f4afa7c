//! One link for several programs: a process that owns the link to a device and shares it by a local socket.
//!
//! An operating system lets only one program open a serial port or claim a USB interface. So the first command that
//! opens a device starts a broker, which is the same program in a process of its own. All commands then communicate
//! with the broker. It ends some seconds after its last client has left, or when its link ends.
//!
//! | module | subject |
//! |---|---|
//! | `place` | the socket and the lock of a device, in the user's runtime folder |
//! | `sharing` | the command that runs as a broker, and the program that starts it |
//! | `hold` | exclusive use of a device by one program |
//! | `message` | messages between a client and the broker |
//! | `join` | the client: finds or starts a broker, and connects to it |
//! | `serve` | the process: its sockets and its end |
//! | `switchboard` | the rules, without input and output: who gets an answer, which activities exclude each other |
//!
//! Invariants: an answer reaches the client that asked, under that client's own sequence number, or nobody. Of the
//! activities that would disturb each other, only one client has one at a time. What other clients send for such an
//! activity does not reach the device, because their motions and keep-alives would keep the lease of the play alive.
//! Frames go to the device in the order of their arrival. Only few frames of each client wait, so that a stop or a
//! motion is not held up by another client's upload. Blocks of a recording go to all clients. A client that reads too
//! slowly loses some blocks, which it counts; no other client loses any.

mod hold;
#[cfg(unix)]
mod join;
#[cfg(unix)]
mod message;
mod place;
#[cfg(unix)]
mod serve;
mod sharing;
#[cfg(unix)]
mod switchboard;

use std::time::Duration;

pub(super) use hold::{Hold, hold};
#[cfg(unix)]
pub(super) use join::{join, open};
#[cfg(unix)]
pub use serve::{Served, serve};
pub use sharing::{BROKER_COMMAND, BROKER_READY, BROKER_TAKEN, Sharing};

/// Time without a client after which a broker ends.
const IDLE: Duration = Duration::from_secs(3);

/// Interval between attempts while another program starts or ends a broker, or has the device exclusively.
const RETRY: Duration = Duration::from_millis(10);
