//! Failures that end a subject of the suite.

use std::path::PathBuf;

use stylus_link::link::LinkError;

/// A failure of the bench, as opposed to a value outside its limits.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum Error {
    /// The link failed, or the device refused a request.
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("{what} within {ms} ms of the device's clock")]
    NotReached {
        /// What did not happen, as the beginning of a sentence.
        what: String,
        /// The time within which it was expected, ms.
        ms: u64,
    },
    /// A program cannot be run, or failed.
    #[error("{program}: {problem}")]
    Program {
        program: String,
        /// The problem and the remedy.
        problem: String,
    },
    /// A file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The system refuses a service that the suite needs.
    #[error("{0}")]
    System(#[from] std::io::Error),
    /// The user ended the run.
    #[error("interrupted")]
    Interrupted,
}

/// Result of a step of the suite.
pub type Result<T> = std::result::Result<T, Error>;
