//! The core itself: registers, FIFOs and endpoints, without a bus and without time. The bus calls it with what came over the
//! wire, and gets the handshake.

mod access;
mod bus;
mod endpoint;
mod fifos;
mod state;

pub use super::packets::{Handshake, InAnswer, Pid};
pub use state::{Core, Told};
