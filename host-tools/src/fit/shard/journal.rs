//! A partial file while it is made: units are appended in their order, so that an interruption loses the last at most.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::file::{End, Fault, Header, Kind, Reader, UnitHead, frame};
use super::identity::encoded;
use crate::support::atomic_file::folder_of;
use crate::support::disk::{Disk, Steps};
use crate::support::error::{Error, Result};
use crate::support::fnv::Fnv;

/// Ending of a journal's name, after that of the partial file.
const UNFINISHED: &str = "unfinished";

/// Ending of the name of a journal of other inputs, from which units are taken over.
const EARLIER: &str = "earlier";

/// A journal.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    /// Number of units in it.
    pub units: usize,
    all: Fnv,
}

/// Returns the path of `path` with another ending after its own.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    PathBuf::from(name)
}

/// Returns the path of the journal of earlier inputs of the partial file at `path`.
pub(super) fn earlier(path: &Path) -> PathBuf {
    with_ending(path, EARLIER)
}

impl Journal {
    /// Opens the journal of the partial file at `path`, which is to hold units of these `heads`, and goes on behind
    /// those that it has. A journal of other inputs is set aside, to take units over from it.
    ///
    /// # Errors
    /// A file that cannot be written, or that another process writes.
    pub fn open(path: &Path, header: &Header, heads: &[UnitHead]) -> Result<Self> {
        let journal = with_ending(path, UNFINISHED);
        let open = || {
            let options = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&journal);
            options.map_err(Error::io("create", &journal))
        };
        let mut file = locked(open()?, &journal)?;
        let mut held = held(&journal, header, heads)?;
        if held.is_none() {
            std::fs::rename(&journal, earlier(path)).map_err(Error::io("rename", &journal))?;
            file = locked(open()?, &journal)?;
            held = Some(Held::default());
        }
        let Held { bytes, units, all } = held.unwrap_or_default();
        file.set_len(bytes).map_err(Error::io("write", &journal))?;
        file.seek(SeekFrom::End(0))
            .map_err(Error::io("write", &journal))?;
        let mut journal = Self {
            path: journal,
            file,
            units,
            all,
        };
        if bytes == 0 {
            journal.write(&frame(Kind::Header, &[&encoded(header)?])?)?;
        }
        Ok(journal)
    }

    /// Appends a unit.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn append(&mut self, head: UnitHead, unit: &[u8]) -> Result<()> {
        self.write(&frame(Kind::Unit, &[&encoded(&head)?, unit])?)?;
        self.units += 1;
        Ok(())
    }

    fn write(&mut self, frame: &[u8]) -> Result<()> {
        self.all = self.all.then(&frame[frame.len() - 8..]);
        self.file
            .write_all(frame)
            .map_err(Error::io("write", &self.path))
    }

    /// Ends the file, brings it to the disk and gives it its name, `path`, which is on the disk at the end.
    ///
    /// # Errors
    /// A file that cannot be written or renamed.
    pub fn finish(self, path: &Path) -> Result<()> {
        self.finish_by(&Disk, path)
    }

    fn finish_by(mut self, steps: &impl Steps, path: &Path) -> Result<()> {
        let end = End {
            units: self.units as u64,
            all: self.all.value(),
        };
        let last = frame(Kind::End, &[&encoded(&end)?])?;
        self.file
            .write_all(&last)
            .map_err(Error::io("write", &self.path))?;
        steps
            .sync_file(&self.path, &self.file)
            .map_err(Error::io("bring to the disk", &self.path))?;
        steps
            .name(path, || std::fs::rename(&self.path, path))
            .map_err(Error::io("rename", &self.path))?;
        steps
            .sync_folder(folder_of(path))
            .map_err(Error::io("bring to the disk the name of", path))?;
        match std::fs::remove_file(earlier(path)) {
            Err(failure) if failure.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::io("remove", &earlier(path))(failure))
            }
            _ => Ok(()),
        }
    }
}

/// Keeps a second process from writing the same file.
fn locked(file: File, path: &Path) -> Result<File> {
    match file.try_lock() {
        Err(std::fs::TryLockError::WouldBlock) => {
            let problem =
                "is being written by another process: wait for its end, or give another folder";
            Err(Error::file(path, problem))
        }
        // Some file systems of a network have no locks.
        Ok(()) | Err(std::fs::TryLockError::Error(_)) => Ok(file),
    }
}

/// Content of a journal that can be kept.
#[derive(Default)]
struct Held {
    bytes: u64,
    units: usize,
    all: Fnv,
}

/// Returns the content of the journal at `path` that is whole and of these inputs; `None` if it is of others.
fn held(path: &Path, header: &Header, heads: &[UnitHead]) -> Result<Option<Held>> {
    let mut reader = Reader::open(path)?;
    let mut held = Held::default();
    let keep = |held: &mut Held, frame: &super::file::Frame| {
        held.all = held.all.then(&frame.hash.to_le_bytes());
        held.bytes = frame.place.end;
    };
    let first = match reader.next() {
        Ok(first) => first,
        Err(Fault::Io(source)) => return Err(Error::io("read", path)(source)),
        Err(Fault::Ended | Fault::Damaged) => return Ok(Some(held)),
    };
    let own = encoded(header)?;
    if first.of_kind(Kind::Header) != Some(own.as_slice()) {
        return Ok(None);
    }
    keep(&mut held, &first);
    loop {
        match reader.next() {
            Ok(frame) => match frame.unit() {
                Some((head, _)) if heads.get(held.units) == Some(&head) => {
                    keep(&mut held, &frame);
                    held.units += 1;
                }
                // The end of a file that got no name yet.
                None if frame.of_kind(Kind::End).is_some() => return Ok(Some(held)),
                _ => return Ok(None),
            },
            Err(Fault::Io(source)) => return Err(Error::io("read", path)(source)),
            Err(Fault::Ended | Fault::Damaged) => return Ok(Some(held)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shard;
    use super::super::identity::MapOptions;
    use super::*;
    use crate::fit::Options;
    use crate::support::disk::watched::Watched;

    /// An empty journal of the partial file at `path`.
    fn journal(path: &Path) -> Journal {
        let options = MapOptions::of(&Options::default());
        Journal::open(path, &Header::new(options, 1, 0, Shard::WHOLE), &[]).unwrap()
    }

    #[test]
    fn the_name_of_a_partial_file_is_on_the_disk_before_an_earlier_one_goes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        let unfinished = with_ending(&path, UNFINISHED);
        std::fs::write(earlier(&path), "units of other inputs").unwrap();
        let watched = Watched::failing_at("folder", "");
        assert!(journal(&path).finish_by(&watched, &path).is_err());
        assert!(earlier(&path).exists());
        let expected = [
            ("file", unfinished),
            ("name", path.clone()),
            ("folder", folder.path().to_owned()),
        ];
        assert_eq!(watched.steps(), expected);
        journal(&path).finish(&path).unwrap();
        assert!(path.exists() && !earlier(&path).exists());
    }
}
