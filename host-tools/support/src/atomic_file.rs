//! Files that are written whole or not at all.
//!
//! The order of the steps ensures this even if the power fails in between: the content is on the disk before the file
//! gets its name.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, BufWriter, Cursor, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::files::{self, Written, other_than_a_file};
use crate::temporaries::{Earlier, Temporary, folder_of};
use crate::{Error, Result};

/// How to replace an existing output, for the command line and for Python.
pub(crate) const REMEDY: &str = "name another, or replace it with --overwrite (overwrite=True in Python)";

/// Files that were not there when a command checked its outputs, and that it may not replace.
static NEW: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Stores whether the next write of the file `target` must fail if another process has written it meanwhile.
pub(crate) fn expect_new(target: &Path, is_new: bool) {
    take_new(target);
    if is_new {
        // A panic of another thread leaves the set whole.
        let mut new = NEW.lock().unwrap_or_else(PoisonError::into_inner);
        new.insert(target.to_owned());
    }
}

/// Returns what [`expect_new`] has stored, and forgets it: the process that wrote a result may write it again.
fn take_new(target: &Path) -> bool {
    NEW.lock().unwrap_or_else(PoisonError::into_inner).remove(target)
}

/// Writes `path` by way of a temporary file in the same folder, which replaces it after `write` has succeeded.
///
/// An earlier file stays until then, and stays after any failure. On Unix, the permissions of a replaced file pass to
/// the new file. A link is followed: the file to which it leads is replaced, and the link stays. Returns the value of
/// `write`.
///
/// # Errors
/// The error of `write`; something at `path` that is not a regular file; or a file that cannot be created, flushed to
/// the disk, or replaced.
pub fn write_with<T>(path: &Path, write: impl FnOnce(&mut BufWriter<&mut Written>) -> Result<T>) -> Result<T> {
    if files::is_in_memory(path) {
        return write_held(path, write);
    }
    let (unnamed, value) = Unnamed::write(path, write)?;
    unnamed.name()?;
    Ok(value)
}

/// Writes a file in memory like [`write_with`].
fn write_held<T>(path: &Path, write: impl FnOnce(&mut BufWriter<&mut Written>) -> Result<T>) -> Result<T> {
    let mut held = Written::Memory(Cursor::default());
    let mut buffer = BufWriter::new(&mut held);
    let value = write(&mut buffer)?;
    buffer.flush().map_err(Error::io("write", path))?;
    drop(buffer);
    if let Written::Memory(bytes) = held {
        files::put(path, bytes.into_inner());
    }
    Ok(value)
}

/// Writes `bytes` to `path`, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_together(&[(path, bytes)])
}

/// Writes several files. No file gets its name before all are on the disk.
///
/// # Errors
/// See [`write()`]. If a file cannot get its name, the files that already have theirs stay.
pub fn write_together(files: &[(&Path, &[u8])]) -> Result<()> {
    let is_held = |(path, _): &&(&Path, &[u8])| files::is_in_memory(path);
    for &(path, bytes) in files.iter().filter(is_held) {
        files::put(path, bytes);
    }
    let written: Vec<Unnamed<'_>> = files
        .iter()
        .filter(|file| !is_held(file))
        .map(|(path, bytes)| {
            Unnamed::write(path, |file| file.write_all(bytes).map_err(Error::io("write", path)))
                .map(|(unnamed, ())| unnamed)
        })
        .collect::<Result<_>>()?;
    written.into_iter().try_for_each(Unnamed::name)
}

/// Returns the path of the file that is written under the name `path`: the file to which a link leads, or `path`
/// itself.
///
/// # Errors
/// A folder, device, pipe or socket, which a file must not replace; or a link that leads nowhere, because it may be
/// meant for another place than the one where a file would appear.
pub fn target(path: &Path) -> Result<PathBuf> {
    if !path.is_symlink() && !path.exists() {
        // A missing folder is reported separately, when the file is created.
        return Ok(path.to_owned());
    }
    let found = match fs::metadata(path) {
        Ok(found) => found,
        Err(failure) if failure.kind() == io::ErrorKind::NotFound => {
            let problem = "is a link to a file that is not there: remove the link, or name another file";
            return Err(Error::file(path, problem));
        }
        Err(failure) => return Err(Error::io("write", path)(failure)),
    };
    if let Some(other) = other_than_a_file(&found) {
        let problem = format!("is {other}, where a file is to be written: name another file");
        return Err(Error::file(path, problem));
    }
    fs::canonicalize(path).map_err(Error::io("follow the link", path))
}

/// Returns the error that an output cannot get its name, for example because another process has taken it.
pub(crate) fn appeared(path: &Path, failure: io::Error) -> Error {
    if failure.kind() == io::ErrorKind::AlreadyExists {
        return Error::file(path, format!("was written by another program meanwhile: {REMEDY}"));
    }
    Error::io("replace", path)(failure)
}

/// A file that is on the disk and has no name yet.
struct Unnamed<'a> {
    path: &'a Path,
    target: PathBuf,
    temporary: Temporary,
}

impl<'a> Unnamed<'a> {
    fn write<T>(path: &'a Path, write: impl FnOnce(&mut BufWriter<&mut Written>) -> Result<T>) -> Result<(Self, T)> {
        let target = target(path)?;
        let permissions = fs::metadata(&target).ok().map(|found| found.permissions());
        // In the target's folder, because a file can be renamed only within one file system.
        let (temporary, file) =
            Temporary::file_in(folder_of(&target), permissions.clone()).map_err(Error::io("create", path))?;
        // Permissions are set before the content is written, which must never be readable by more users than the
        // earlier file was. The umask may have removed some permissions.
        if let Some(permissions) = permissions.filter(|_| cfg!(unix)) {
            file.set_permissions(permissions).map_err(Error::io("write", path))?;
        }
        let mut written = Written::Disk(file);
        let mut buffer = BufWriter::new(&mut written);
        let value = write(&mut buffer)?;
        buffer.flush().map_err(Error::io("write", path))?;
        drop(buffer);
        written.sync().map_err(Error::io("bring to the disk", path))?;
        let unnamed = Self {
            path,
            target,
            temporary,
        };
        Ok((unnamed, value))
    }

    fn name(self) -> Result<()> {
        // An empty file, such as one of `mktemp`, may be replaced.
        let is_empty = fs::metadata(&self.target).is_ok_and(|found| found.len() == 0);
        let is_new = take_new(&self.target) && !is_empty;
        let earlier = if is_new { Earlier::Nothing } else { Earlier::File };
        self.temporary
            .persist(&self.target, earlier)
            .map_err(|failure| appeared(self.path, failure))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_content_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result");
        write(&path, b"old").unwrap();
        let outcome = write_with(&path, |file| {
            file.write_all(b"half of the n").unwrap();
            Err::<(), _>(Error::Request("stopped".into()))
        });
        assert!(outcome.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn files_that_belong_together_are_all_written_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let (one, two) = (folder.path().join("one"), folder.path().join("two"));
        fs::create_dir(&two).unwrap();
        assert!(write_together(&[(&one, b"1"), (&two, b"2")]).is_err());
        assert!(!one.exists());
        fs::remove_dir(&two).unwrap();
        write_together(&[(&one, b"1"), (&two, b"2")]).unwrap();
        assert_eq!(fs::read(&one).unwrap(), b"1");
        assert_eq!(fs::read(&two).unwrap(), b"2");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_an_ordinary_file_or_of_the_one_that_is_replaced() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o7777;
        let (ordinary, written) = (folder.path().join("ordinary"), folder.path().join("written"));
        fs::write(&ordinary, "").unwrap();
        write(&written, b"").unwrap();
        assert_eq!(mode(&written), mode(&ordinary));
        fs::set_permissions(&written, fs::Permissions::from_mode(0o640)).unwrap();
        write(&written, b"again").unwrap();
        assert_eq!(mode(&written), 0o640);
        fs::set_permissions(&written, fs::Permissions::from_mode(0o600)).unwrap();
        write_with(&written, |_| {
            let modes = fs::read_dir(folder.path()).unwrap();
            let mut hidden = modes
                .map(|entry| entry.unwrap().path())
                .filter(|path| *path != ordinary && *path != written);
            assert_eq!(mode(&hidden.next().unwrap()), 0o600);
            Ok(())
        })
        .unwrap();
    }
}
