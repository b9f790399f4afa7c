//! Runs the stylus's flashed image, unmodified, on an emulated STM32H743 in virtual time.
//!
//! The emulator is `rigless`: the core, the memories and most of the part. The peripherals that it lacks are in
//! [`model`]. The module doc of each model names the sections of RM0433 that it follows, and what it leaves out. Also
//! left out are caches, wait states, the assignment of functions to pins, and everything analogue but the levels at the
//! converters' pins.
//!
//! [`VirtualStylus`] runs an image for tests, from instant to instant. Between two runs a test reads state, feeds
//! inputs or cuts the power. The core retires
//! [`PESSIMISTIC_INSTRUCTIONS_PER_SECOND`](board::PESSIMISTIC_INSTRUCTIONS_PER_SECOND), so a deadline that is met here
//! is met on the part with a margin.

pub mod actuator;
pub mod board;
pub mod core;
pub mod electrical;
pub mod emulation;
pub mod error;
pub mod flash_file;
pub mod model;
pub mod motion;
pub mod pace;
pub mod part;
pub mod sensors;
pub mod serial;
pub mod sockets;
pub mod stylus;
pub mod tick;
pub mod usb_host;

pub use electrical::Electrical;
pub use emulation::{Options, PowerCut};
pub use error::{Error, Result};
pub use stylus::{Reset, ResetCause, RunReport, VirtualStylus};
pub use stylus_plant::chance;
