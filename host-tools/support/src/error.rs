//! Failures in words for the user: the problem, its place, and the remedy.

use std::path::{Path, PathBuf};

/// A failure of a host tool. Each message is one line that names the file, the place in it and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    Io {
        /// The operation, as a verb.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The content of a file cannot be used.
    #[error("{path}: {problem}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem and the remedy.
        problem: String,
    },
    /// A line of a text file cannot be used.
    #[error("{path}, line {line}: {problem}", path = path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// The problem and the remedy.
        problem: String,
    },
    /// The bytes of a texture library are not valid.
    #[error("{path}: {source}", path = path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// The problem and its place.
        source: model_format::DecodeError,
    },
    /// Models cannot be encoded as a library.
    #[error("{0}")]
    Model(String),
    /// A request cannot be fulfilled, for a reason that is not in a file.
    #[error("{0}")]
    Request(String),
}

/// Result of a host tool.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Returns a function for `map_err` that adds the operation and the file to an I/O error.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// Returns an error about the content of a file.
    pub fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File {
            path: path.to_owned(),
            problem: problem.into(),
        }
    }

    /// Returns an error about a line, from 1, of a file.
    pub fn line(path: &Path, line: u64, problem: impl Into<String>) -> Self {
        Self::Line {
            path: path.to_owned(),
            line,
            problem: problem.into(),
        }
    }
    /// Returns the error with its path, if it has one, replaced by the result of `of`.
    #[must_use]
    pub(crate) fn with_path(mut self, of: impl FnOnce(&Path) -> PathBuf) -> Self {
        if let Self::Io { path, .. } | Self::File { path, .. } | Self::Line { path, .. } | Self::Library { path, .. } =
            &mut self
        {
            *path = of(path);
        }
        self
    }
}
