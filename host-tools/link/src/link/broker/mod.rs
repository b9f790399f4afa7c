//! One link for several programs: a process that owns the link to a device and shares it by a local socket.
//!
//! A system lets one program open a serial port or claim a USB interface. So the first command that opens a device
//! starts a broker, which is the same program in a process of its own, and all commands speak to that. It ends some
//! seconds after its last client, or with its link.
//!
//! | module | subject |
//! |---|---|
//! | `place` | the socket and the lock of a device, in the user's runtime folder |
//! | `sharing` | the command that is a broker, and the program that starts it |
//! | `hold` | a device that one program has alone |
//! | `message` | messages between a client and the broker |
//! | `join` | a client's side: finds a broker, starts one where there is none, and is its client |
//! | `serve` | the process: its sockets and its end |
//! | `switchboard` | the rules, without input and output: answers go to who asked, and motion has one holder |
//!
//! Invariants: an answer reaches the client that asked, under its own sequence number, or nobody. Of the activities
//! that would disturb each other one client has one at a time; what the others send for theirs does not reach the
//! device, because a play's motions and keep-alives would keep the lease alive. Frames go to the device in the order of
//! their arrival, and few of each client wait, so that a stop or a motion is not held up by another client's upload.
//! Blocks of a recording go to all clients; one that reads too slowly loses some, which it counts; nobody else does.

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

/// Interval between attempts while another program starts or ends a broker.
const RETRY: Duration = Duration::from_millis(10);
