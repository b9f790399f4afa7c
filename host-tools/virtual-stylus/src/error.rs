//! Errors of a run.

use std::path::PathBuf;

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
