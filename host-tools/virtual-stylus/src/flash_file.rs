//! The file that keeps the flash from run to run. Only one run can use it at a time.
//!
//! The lock is the operating system's lock on the open file, so it vanishes with the process, however the process ends.
//! The file is written in place: if it were replaced by a new file, the lock would remain on the old one.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::model::flash::Contents;
use crate::{Error, Result};

/// The file, open and locked.
#[derive(Debug)]
pub struct FlashFile {
    path: PathBuf,
    file: File,
}

impl FlashFile {
    /// Opens the file at `path`, or creates it, and locks it. Returns the file and its content. A new or empty file
    /// holds an erased flash.
    ///
    /// # Errors
    /// The file is not a regular file, cannot be opened or locked, has another length than a flash, or is in use by
    /// another run.
    pub fn open(path: &Path) -> Result<(Self, Contents)> {
        let told = |reason: String| Error::FlashFile {
            path: path.to_owned(),
            reason,
        };
        // This is checked before the file is opened, because opening a pipe would wait.
        if std::fs::metadata(path).is_ok_and(|found| !found.is_file()) {
            return Err(told("is not a regular file".to_owned()));
        }
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let file = (options.open(path)).map_err(|error| told(error.to_string()))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(Error::FlashFileInUse { path: path.to_owned() });
            }
            Err(TryLockError::Error(error)) => return Err(told(error.to_string())),
        }
        let metadata = file.metadata().map_err(|error| told(error.to_string()))?;
        let contents = if metadata.len() == 0 {
            Contents::default()
        } else {
            Contents::read(path)?
        };
        let path = path.to_owned();
        Ok((Self { path, file }, contents))
    }

    /// Overwrites the file with `contents`.
    pub fn write(&mut self, contents: &Contents) -> Result<()> {
        let bytes = contents.to_bytes();
        let mut write = || {
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(&bytes)?;
            // The flash may have fewer marked words than before.
            self.file.set_len(bytes.len() as u64)
        };
        write().map_err(|error| Error::FlashFile {
            path: self.path.clone(),
            reason: error.to_string(),
        })
    }
}
