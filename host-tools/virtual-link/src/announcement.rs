//! Announcements of virtual styluses, in the user's runtime folder, so that other programs find them.
//!
//! A file has the virtual time of one virtual stylus in its first line, and one of its links in each further line. The
//! file is locked as long as the virtual stylus runs, so that a killed one is not found.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crate::runtime_folder;

/// Prefix of the names of the files.
const PREFIX: &str = "virtual-";

/// Number of the next announcement of this process.
static NUMBER: AtomicU32 = AtomicU32::new(0);

/// Longest announcement that is read, bytes.
const MAX_BYTES: u64 = 4096;

/// Announcement of a virtual stylus, which ends when this is dropped.
#[derive(Debug)]
pub struct Announcement {
    path: PathBuf,
    locked: File,
}

impl Announcement {
    /// Announces a virtual stylus of this process with these links, as `stylus --link` accepts them.
    pub fn new(links: &[String]) -> io::Result<Self> {
        Self::within(&runtime_folder::own()?, links)
    }

    fn within(folder: &Path, links: &[String]) -> io::Result<Self> {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("{}-{number}", std::process::id());
        // The file gets its final name once it is locked and complete.
        let unnamed = folder.join(format!("new-{name}"));
        let path = folder.join(format!("{PREFIX}{name}"));
        let mut file = File::create(&unnamed)?;
        file.lock()?;
        write_time(&mut file, Duration::ZERO)?;
        for link in links {
            writeln!(file, "{link}")?;
        }
        fs::rename(&unnamed, &path)?;
        Ok(Self { path, locked: file })
    }

    /// Writes the virtual time of the virtual stylus.
    pub fn tell_time(&mut self, time: Duration) -> io::Result<()> {
        self.locked.rewind()?;
        write_time(&mut self.locked, time)
    }
}

/// Writes the first line, which always has the same length.
fn write_time(file: &mut File, time: Duration) -> io::Result<()> {
    file.write_all(format!("{:020}\n", time.as_micros()).as_bytes())
}

impl Drop for Announcement {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// A virtual stylus that is announced and runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Announced {
    /// Links of the virtual stylus, as `stylus --link` accepts them.
    pub links: Vec<String>,
    /// Virtual time of the virtual stylus as it was written last.
    pub time: Duration,
}

/// Returns every virtual stylus that is announced and runs; none if the runtime folder cannot be used.
pub fn announced() -> Vec<Announced> {
    runtime_folder::own().map_or_else(|_| Vec::new(), |folder| announced_in(&folder))
}

fn announced_in(folder: &Path) -> Vec<Announced> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(PREFIX))
        .map(|entry| entry.path())
        .collect();
    paths.sort();
    paths.iter().filter_map(|path| read(path)).collect()
}

/// Returns the content of an announcement; none if its virtual stylus is gone, or is still writing it.
fn read(path: &Path) -> Option<Announced> {
    // A pipe of this name would block its reader.
    if !fs::symlink_metadata(path).ok()?.is_file() {
        return None;
    }
    let file = File::open(path).ok()?;
    match file.try_lock_shared() {
        Err(TryLockError::WouldBlock) => {}
        Ok(()) => {
            // Nobody holds the lock, so a virtual stylus that was killed has left the file.
            let _ = fs::remove_file(path);
            return None;
        }
        Err(TryLockError::Error(_)) => return None,
    }
    let mut text = String::new();
    file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
    let mut lines = text.lines();
    let time = Duration::from_micros(lines.next()?.parse().ok()?);
    let links: Vec<String> = lines.map(str::to_owned).collect();
    (!links.is_empty()).then_some(Announced { links, time })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_virtual_stylus_is_found_while_it_lives_and_one_that_was_killed_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let one = ["tcp:127.0.0.1:4000", "usb-virtual:127.0.0.1:4001"].map(str::to_owned);
        let other = ["tcp:127.0.0.1:5000".to_owned()];
        let mut first = Announcement::within(folder.path(), &one).unwrap();
        let second = Announcement::within(folder.path(), &other).unwrap();
        // A file without a lock is what a killed process leaves.
        let left = folder.path().join("virtual-1-0");
        fs::write(&left, "0\ntcp:127.0.0.1:6000\n").unwrap();
        fs::write(folder.path().join("other-1"), "tcp:127.0.0.1:7000\n").unwrap();
        let of = |links: &[String], time| Announced {
            links: links.to_vec(),
            time,
        };
        let other = of(&other, Duration::ZERO);
        let found = announced_in(folder.path());
        assert_eq!(found, [of(&one, Duration::ZERO), other.clone()]);
        assert!(!left.exists());
        for time in [u64::MAX, 7].map(Duration::from_micros) {
            first.tell_time(time).unwrap();
            assert_eq!(announced_in(folder.path())[0], of(&one, time));
        }
        drop(first);
        assert_eq!(announced_in(folder.path()), [other]);
        drop(second);
        assert!(announced_in(folder.path()).is_empty());
    }
}
