//! The core itself: registers, FIFOs and endpoints, without a bus and without time. The bus passes the packets on the
//! wire to it, and receives the handshakes.

mod access;
mod bus;
mod state;

pub use super::packets::{Handshake, InAnswer, Pid};
pub use state::{Core, RegisterMisuse};
