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

pub mod board;
pub mod core;
pub mod electrical;
pub mod emulation;
pub mod flash_file;

/// The board's own models, which replace or wrap the emulator's models of the part.
///
/// Every section number is RM0433's (Rev 8, or Rev 9 where the emulator's own models cite it; the sections named here
/// are the same in both).
pub mod model {
    pub mod adc;
    pub mod around;
    pub mod dac;
    pub mod encoder;
    pub mod flash;
    pub mod oscillators;
    pub mod pins;
    pub mod ram;
    pub mod trigger;
    pub mod usb;
    pub mod watchdog;
}

pub mod motion;
pub mod pace;
pub mod part;
pub mod sensors;
pub mod sockets;
pub mod stylus;
pub mod tick;
pub mod usb_host;

use std::path::PathBuf;

pub use electrical::Electrical;
pub use emulation::{Options, PowerCut};
pub use stylus::{Reset, ResetCause, RunReport, VirtualStylus};
pub use stylus_plant::chance;

/// An error of a run.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The image could not be read or placed.
    #[error("{path}: {reason}; name the ELF file that `cargo firmware` builds")]
    Image {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The kept contents of the flash could not be read or written.
    #[error("{path}: {reason}; name another file, or leave it out to start with an erased flash")]
    FlashFile {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// Another run uses the file for its flash.
    #[error("{path}: another virtual stylus keeps its flash in it: end that one, or name another file with --flash")]
    FlashFileInUse {
        /// The file.
        path: PathBuf,
    },
    /// A motion cannot be used.
    #[error("motion {0}")]
    Motion(String),
    /// The socket of the serial line or of USB could not be opened.
    #[error("port {port}: {reason}; name another one")]
    Port {
        /// The port asked for, 0 for any.
        port: u16,
        /// The reason.
        reason: String,
    },
    /// The emulator could not begin, or stopped by itself.
    #[error("the emulator stopped: {0}")]
    Emulator(String),
}

/// The result of an operation on a run.
pub type Result<T> = std::result::Result<T, Error>;
