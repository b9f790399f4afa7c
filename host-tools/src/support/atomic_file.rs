//! Files that are written whole or not at all.
//!
//! The order of steps makes it so also where the power fails in between: the content is on the disk before the file
//! gets its name, and the name is on the disk before the write counts as done.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use tempfile::NamedTempFile;

use crate::support::error::{Error, Result};

/// Writes `path` by way of a temporary file in the same folder, which replaces it after `write` has succeeded.
///
/// An earlier file stays until then, and stays after any failure; one that is replaced hands its permissions on. A new
/// file has those of an ordinary one. Returns the value of `write`.
///
/// # Errors
/// The error of `write`, or a file that cannot be created, brought to the disk, or replaced.
pub fn write_with<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<T>,
) -> Result<T> {
    write_through(&Disk, path, write)
}

/// Writes `bytes` to `path`, whole or not at all.
///
/// # Errors
/// A file that cannot be created, written or replaced.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| {
        file.write_all(bytes).map_err(Error::io("write", path))
    })
}

/// The steps after the content was written. Tests watch them, and let them fail.
trait Steps {
    /// Brings a file's content to the disk.
    fn sync_file(&self, file: &File) -> io::Result<()>;
    /// Gives the file its name.
    fn rename(&self, file: NamedTempFile, path: &Path) -> io::Result<()>;
    /// Brings the names in a folder to the disk.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;
}

struct Disk;

impl Steps for Disk {
    fn sync_file(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    fn rename(&self, file: NamedTempFile, path: &Path) -> io::Result<()> {
        // The temporary file is removed if it cannot get the name.
        file.persist(path)
            .map(drop)
            .map_err(|failure| failure.error)
    }

    #[cfg(unix)]
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match File::open(folder)?.sync_all() {
            // Some file systems of a network have no such operation for folders.
            Err(failure)
                if [io::ErrorKind::InvalidInput, io::ErrorKind::Unsupported]
                    .contains(&failure.kind()) =>
            {
                Ok(())
            }
            outcome => outcome,
        }
    }

    #[cfg(not(unix))]
    fn sync_folder(&self, _folder: &Path) -> io::Result<()> {
        Ok(())
    }
}

fn write_through<T>(
    steps: &impl Steps,
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<T>,
) -> Result<T> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut temporary = temporary_in(folder).map_err(Error::io("create", path))?;
    let mut buffer = BufWriter::new(temporary.as_file_mut());
    let value = write(&mut buffer)?;
    buffer.flush().map_err(Error::io("write", path))?;
    drop(buffer);
    keep_permissions(temporary.as_file(), path).map_err(Error::io("write", path))?;
    steps
        .sync_file(temporary.as_file())
        .map_err(Error::io("bring to the disk", path))?;
    steps
        .rename(temporary, path)
        .map_err(Error::io("replace", path))?;
    steps
        .sync_folder(folder)
        .map_err(Error::io("bring to the disk the name of", path))?;
    Ok(value)
}

/// Creates a file with the permissions of an ordinary one: the process's umask takes its share. A temporary file would
/// be its owner's alone.
#[cfg(unix)]
fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    use std::os::unix::fs::PermissionsExt;
    tempfile::Builder::new()
        .prefix(".stylus-")
        .permissions(std::fs::Permissions::from_mode(0o666))
        .tempfile_in(folder)
}

#[cfg(not(unix))]
fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .prefix(".stylus-")
        .tempfile_in(folder)
}

/// Gives `file` the permissions of the file at `path`, which it will replace, if there is one.
#[cfg(unix)]
fn keep_permissions(file: &File, path: &Path) -> io::Result<()> {
    match std::fs::metadata(path) {
        Ok(earlier) if earlier.is_file() => file.set_permissions(earlier.permissions()),
        _ => Ok(()),
    }
}

#[cfg(not(unix))]
fn keep_permissions(_file: &File, _path: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

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
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    /// A step's name, and the content under the file's name before it.
    type Step = (&'static str, Vec<u8>);

    /// The disk, with a record of the steps; the one of this name fails.
    struct Watched {
        failing: &'static str,
        steps: RefCell<Vec<Step>>,
        path: std::path::PathBuf,
    }

    impl Watched {
        fn step(&self, name: &'static str) -> io::Result<()> {
            let named = std::fs::read(&self.path).unwrap();
            self.steps.borrow_mut().push((name, named));
            if name == self.failing {
                return Err(io::Error::other("the disk is full"));
            }
            Ok(())
        }
    }

    impl Steps for Watched {
        fn sync_file(&self, file: &File) -> io::Result<()> {
            assert_eq!(file.metadata()?.len(), 3, "all of it was written before");
            self.step("file").and_then(|()| Disk.sync_file(file))
        }

        fn rename(&self, file: NamedTempFile, path: &Path) -> io::Result<()> {
            self.step("rename").and_then(|()| Disk.rename(file, path))
        }

        fn sync_folder(&self, folder: &Path) -> io::Result<()> {
            self.step("folder").and_then(|()| Disk.sync_folder(folder))
        }
    }

    /// Replaces `old` by `new`, with a step that fails: the outcome, the steps with the content under the name before
    /// each, the content after, and the number of files.
    fn replaced(failing: &'static str) -> (Result<()>, Vec<Step>, Vec<u8>, usize) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result");
        std::fs::write(&path, "old").unwrap();
        let watched = Watched {
            failing,
            steps: RefCell::default(),
            path: path.clone(),
        };
        let outcome = write_through(&watched, &path, |file| {
            file.write_all(b"new").map_err(Error::io("write", &path))
        });
        let files = std::fs::read_dir(folder.path()).unwrap().count();
        let steps = watched.steps.into_inner();
        (outcome, steps, std::fs::read(&path).unwrap(), files)
    }

    #[test]
    fn content_is_on_the_disk_before_its_name_and_the_name_before_the_end() {
        let (outcome, steps, content, files) = replaced("");
        assert!(outcome.is_ok());
        let expected = [("file", "old"), ("rename", "old"), ("folder", "new")];
        let expected = expected.map(|(step, content)| (step, content.as_bytes().to_vec()));
        assert_eq!(steps, expected);
        assert_eq!((content.as_slice(), files), (&b"new"[..], 1));
    }

    #[test]
    fn a_step_that_fails_is_an_error_and_leaves_one_whole_file() {
        for (failing, content) in [("file", "old"), ("rename", "old"), ("folder", "new")] {
            let (outcome, _, found, files) = replaced(failing);
            let message = outcome.unwrap_err().to_string();
            assert!(
                message.contains("result: cannot") && message.contains("full"),
                "{message}"
            );
            assert_eq!(
                (found.as_slice(), files),
                (content.as_bytes(), 1),
                "{failing}"
            );
        }
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_an_ordinary_file_or_of_the_one_that_is_replaced() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o7777;
        let (ordinary, written) = (
            folder.path().join("ordinary"),
            folder.path().join("written"),
        );
        std::fs::write(&ordinary, "").unwrap();
        write(&written, b"").unwrap();
        assert_eq!(mode(&written), mode(&ordinary));
        for kept in [0o600, 0o640, 0o664] {
            let permissions = std::fs::Permissions::from_mode(kept);
            std::fs::set_permissions(&written, permissions).unwrap();
            write(&written, b"again").unwrap();
            assert_eq!(mode(&written), kept);
        }
    }
}
