//! What can go wrong, in words for the person at the keyboard: what, where, and what to do.

use std::path::{Path, PathBuf};

/// A failure of a host tool. Each is one line that names the file, the place in it and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    Io {
        /// What was to be done with it, as a verb.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A file was read, and what it holds cannot be used.
    #[error("{path}: {problem}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        problem: String,
    },
    /// A line of a text file cannot be used.
    #[error("{path}, line {line}: {problem}", path = path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// What is wrong, and what to do about it.
        problem: String,
    },
    /// The bytes of a texture library do not hold.
    #[error("{path}: {source}", path = path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: model_format::DecodeError,
    },
    /// Models could not be made into a library.
    #[error("{0}")]
    Model(String),
    /// A request that no file is to blame for.
    #[error("{0}")]
    Request(String),
}

/// What the tools return.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Makes an I/O error into one that names the file; for `map_err`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io {
            action,
            path,
            source,
        }
    }

    /// A file whose content cannot be used.
    pub fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File {
            path: path.to_owned(),
            problem: problem.into(),
        }
    }

    /// A line, from 1, that cannot be used.
    pub fn line(path: &Path, line: u64, problem: impl Into<String>) -> Self {
        Self::Line {
            path: path.to_owned(),
            line,
            problem: problem.into(),
        }
    }
}
