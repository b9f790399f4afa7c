//! One link for several programs: a process that owns the link to a device and shares it by a local socket.
//!
//! A system lets one program open a serial port or claim a USB interface. So the first command that opens a device
//! starts a broker, which is the same program in a process of its own, and all commands speak to that. It ends some
//! seconds after its last client, or with its link.
//!
//! | module | subject |
//! |---|---|
//! | `alone` | without sockets of files: one command at a time has a device |
//! | `place` | the socket and the lock of a device, in the user's runtime folder |
//! | `message` | messages between a client and the broker |
//! | `join` | a client's side: finds a broker, starts one where there is none, and is its client |
//! | `serve` | the process: its sockets and its end |
//! | `switchboard` | the rules, without input and output: answers go to who asked, and motion has one holder |
//!
//! Invariants: an answer reaches the client that asked, under its own sequence number, or nobody. One client gives the
//! motion; plays, motions and keep-alives of the others do not reach the device, because each would keep its lease
//! alive. Frames go to the device in the order of their arrival, and few of each client wait, so that a stop or a
//! motion is not held up by another client's upload. Blocks of a recording go to all clients; one that reads too
//! slowly loses some, which it counts, and nobody else does.

#[cfg(any(not(unix), test))]
mod alone;
#[cfg(unix)]
mod join;
#[cfg(unix)]
mod message;
mod place;
#[cfg(unix)]
mod serve;
#[cfg(unix)]
mod switchboard;

#[cfg(not(unix))]
pub(super) use alone::{free, join, open};
#[cfg(unix)]
pub(super) use join::{free, join, open};
#[cfg(unix)]
pub use serve::{Served, serve};
