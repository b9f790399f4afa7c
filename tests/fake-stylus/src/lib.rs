//! A stylus in memory, for tests and examples: the application of `firmware/app` on fake hardware and fake flash.
//!
//! The application is the device's own. The fake replaces the code that `firmware/src` adds for the microcontroller,
//! and follows it, so that a mistake in how the parts are put together shows without a board. There are two ways to use
//! it:
//!
//! - [`FakeStylus`] runs behind a TCP port, and a host talks to it like to a board. Its clock follows real time as far
//!   as the host keeps up. Faults of the device and of the link can be injected.
//! - [`SteppedStylus`](device::SteppedStylus) runs in virtual time, one millisecond after the other, and a test calls
//!   the application's requests itself.
#![expect(
    clippy::result_large_err,
    reason = "the device's errors carry their reason as text, because it has no heap"
)]

pub mod actuator;
mod board;
mod connection;
pub mod device;
pub mod flash;
pub mod hardware;
pub mod library;
pub mod requests;
mod served;

pub use board::{Board, Hand};
pub use connection::Faults;
pub use device::BoardOf;
pub use hardware::BOARD;
pub use served::{FakeStylus, HeardFrame, StartedImage};
