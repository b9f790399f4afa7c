//! Identity of a file under all its names: other spellings, links, hard links.

use std::path::{Path, PathBuf};

/// The identity of a file that is there.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Identity {
    /// Device and number in it.
    Numbers(u64, u64),
    /// The path without links, where the system tells no numbers.
    Path(PathBuf),
}

impl Identity {
    /// Returns the identity of the file at `path`, with links followed; `None` if there is none.
    #[cfg(unix)]
    pub fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        let found = std::fs::metadata(path).ok()?;
        Some(Self::Numbers(found.dev(), found.ino()))
    }

    /// Returns the identity of the file at `path`, with links followed; `None` if there is none.
    #[cfg(not(unix))]
    pub fn of(path: &Path) -> Option<Self> {
        std::fs::canonicalize(path).ok().map(Self::Path)
    }
}
