//! One link for several programs: a process that owns the link to a device and shares it by a local socket.
//!
//! A system lets one program open a serial port or claim a USB interface. So the first command that opens a device
//! starts a broker, which is the same program in a process of its own, and all commands speak to that. It ends some
//! seconds after its last client, or with its link.
//!
//! | module | subject |
//! |---|---|
//! | `place` | the socket and the lock of a device, in the user's runtime folder |
//! | `greeting` | the first message of either side, which never changes its form |
//! | `message` | messages after it |
//! | `join` | a client's side: finds a broker, starts one where there is none, and is its client |
//! | `serve` | the process: its sockets, queues and end |
//! | `outgoing` | frames on their way to the device, in the order of their urgency |
//! | `switchboard` | the rules, without input and output: answers go to who asked, and motion has one holder |
//! | `recording` | one recording of the device for several clients |
//!
//! Invariants: an answer reaches the client that asked, under its own sequence number, or nobody. One client gives the
//! motion; plays, motions and keep-alives of the others do not reach the device, because each would keep its lease
//! alive. A stop reaches it from any client, before all that waits. A client that reads too slowly loses blocks of
//! recordings, which it counts, and nobody else does.

mod greeting;
mod join;
mod message;
mod outgoing;
mod place;
mod recording;
mod serve;
mod switchboard;

pub(super) use join::{join, leave, open};
pub use serve::{Served, serve};
