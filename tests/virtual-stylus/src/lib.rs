//! The stylus's flashed image, unmodified, on an emulated STM32H743 in virtual time.
//!
//! The emulator is `rigless`: the core, the memories and most of the part. What it does not model and the stylus needs is
//! in [`model`], each with the sections of RM0433 it follows and what it leaves out at its head. Beyond that this board
//! leaves out: caches and wait states, the analogue side of everything, and which pin a function comes out at.
//!
//! [`VirtualStylus`] runs an image for tests: to an instant, and at each stop one may look, feed, or cut the power. The
//! core retires [`PESSIMISTIC_INSTRUCTIONS_PER_SECOND`], a deadline that is met then is met with a margin on the part.

pub mod board;
pub mod core;
pub mod error;
pub mod model;
pub mod motion;
pub mod part;
pub mod pins;
pub mod serial;
pub mod stylus;
pub mod tick;
pub mod usb_host;
pub mod usb_socket;

pub use error::{Error, Result};
pub use stylus::{
    Options, PESSIMISTIC_INSTRUCTIONS_PER_SECOND, Report, Reset, ResetCause, VirtualStylus,
};
