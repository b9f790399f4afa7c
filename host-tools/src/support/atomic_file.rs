//! Files that are written whole or not at all.
//!
//! The order of steps makes it so also where the power fails in between: the content is on the disk before the file
//! gets its name, and the name is on the disk before the write counts as done.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::support::disk::{Disk, Steps};
use crate::support::error::{Error, Result};
use crate::support::temporaries::TemporaryFile;

/// Writes `path` by way of a temporary file in the same folder, which replaces it after `write` has succeeded.
///
/// An earlier file stays until then, and stays after any failure; one that is replaced hands its permissions on. A new
/// file has those of an ordinary one. A link is followed: the file at its end is replaced, and the link stays. Returns
/// the value of `write`.
///
/// # Errors
/// The error of `write`, something at `path` that is no regular file, or a file that cannot be created, brought to the
/// disk, or replaced.
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

/// Writes several files: none has its name before all are on the disk.
///
/// # Errors
/// As [`write()`]. Files that have their names already stay where a later one cannot get its own.
pub fn write_together(files: &[(&Path, &[u8])]) -> Result<()> {
    let written = files.iter().map(|(path, bytes)| {
        let content = |file: &mut BufWriter<&mut File>| {
            file.write_all(bytes).map_err(Error::io("write", path))
        };
        Unnamed::write(&Disk, path, content).map(|(unnamed, ())| unnamed)
    });
    let written: Vec<Unnamed<'_>> = written.collect::<Result<_>>()?;
    written.into_iter().try_for_each(|file| file.name(&Disk))
}

/// Returns the path of the file that is written under the name `path`: that at the end of a link, or `path` itself.
///
/// # Errors
/// A folder, device, pipe or socket, which a file must not replace; a link to nothing, because it may be meant for
/// another place than the one where a file would appear.
pub fn target(path: &Path) -> Result<PathBuf> {
    let found = match fs::symlink_metadata(path) {
        Ok(found) => found,
        // A folder that is missing is an error of its own, when the file is created.
        Err(failure) if is_missing(&failure) => return Ok(path.to_owned()),
        Err(failure) => return Err(Error::io("write", path)(failure)),
    };
    if !found.is_symlink() {
        return regular(path, &found).map(|()| path.to_owned());
    }
    let end = match fs::canonicalize(path) {
        Ok(end) => end,
        Err(failure) if is_missing(&failure) => {
            let problem =
                "is a link to a file that is not there: remove the link, or name another file";
            return Err(Error::file(path, problem));
        }
        Err(failure) => return Err(Error::io("follow the link", path)(failure)),
    };
    let found = fs::metadata(&end).map_err(Error::io("write", path))?;
    regular(path, &found).map(|()| end)
}

/// Refuses what is no regular file. It is decided by the type, before anything is opened.
fn regular(path: &Path, found: &fs::Metadata) -> Result<()> {
    let Some(other) = other_than_a_file(found) else {
        return Ok(());
    };
    let problem = format!("is {other}, where a file is to be written: name another file");
    Err(Error::file(path, problem))
}

/// Returns true if nothing is at a path.
fn is_missing(failure: &io::Error) -> bool {
    [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&failure.kind())
}

/// Names, with its article, what is at a path if it is no regular file.
pub fn other_than_a_file(found: &fs::Metadata) -> Option<&'static str> {
    let kind = found.file_type();
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some("a folder");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_block_device() || kind.is_char_device() {
            return Some("a device");
        }
    }
    Some("no regular file")
}

/// Folder of the file at `path`.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn write_through<T>(
    steps: &impl Steps,
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<T>,
) -> Result<T> {
    let (unnamed, value) = Unnamed::write(steps, path, write)?;
    unnamed.name(steps)?;
    Ok(value)
}

/// A file that is on the disk and has no name yet.
struct Unnamed<'a> {
    path: &'a Path,
    target: PathBuf,
    temporary: TemporaryFile,
}

impl<'a> Unnamed<'a> {
    fn write<T>(
        steps: &impl Steps,
        path: &'a Path,
        write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<T>,
    ) -> Result<(Self, T)> {
        let target = target(path)?;
        let folder = folder_of(&target);
        let mut temporary = TemporaryFile::new_in(folder).map_err(Error::io("create", path))?;
        let mut buffer = BufWriter::new(temporary.as_file_mut());
        let value = write(&mut buffer)?;
        buffer.flush().map_err(Error::io("write", path))?;
        drop(buffer);
        keep_permissions(temporary.as_file(), &target).map_err(Error::io("write", path))?;
        steps
            .sync_file(path, temporary.as_file())
            .map_err(Error::io("bring to the disk", path))?;
        let unnamed = Self {
            path,
            target,
            temporary,
        };
        Ok((unnamed, value))
    }

    fn name(self, steps: &impl Steps) -> Result<()> {
        let Self {
            path,
            target,
            temporary,
        } = self;
        // The temporary file is removed if it cannot get the name.
        steps
            .name(&target, || temporary.persist(&target))
            .map_err(Error::io("replace", path))?;
        steps
            .sync_folder(folder_of(&target))
            .map_err(Error::io("bring to the disk the name of", path))
    }
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
    use std::sync::Mutex;

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
        steps: Mutex<Vec<Step>>,
        path: std::path::PathBuf,
    }

    impl Watched {
        fn step(&self, name: &'static str) -> io::Result<()> {
            let named = std::fs::read(&self.path).unwrap();
            self.steps.lock().unwrap().push((name, named));
            if name == self.failing {
                return Err(io::Error::other("the disk is full"));
            }
            Ok(())
        }
    }

    impl Steps for Watched {
        fn sync_file(&self, path: &Path, file: &File) -> io::Result<()> {
            assert_eq!(file.metadata()?.len(), 3, "all of it was written before");
            self.step("file").and_then(|()| Disk.sync_file(path, file))
        }

        fn name(&self, path: &Path, rename: impl FnOnce() -> io::Result<()>) -> io::Result<()> {
            self.step("rename").and_then(|()| Disk.name(path, rename))
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
            steps: Mutex::default(),
            path: path.clone(),
        };
        let outcome = write_through(&watched, &path, |file| {
            file.write_all(b"new").map_err(Error::io("write", &path))
        });
        let files = std::fs::read_dir(folder.path()).unwrap().count();
        let steps = watched.steps.into_inner().unwrap();
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
    fn files_that_belong_together_are_all_written_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let (one, two) = (folder.path().join("one"), folder.path().join("two"));
        std::fs::create_dir(&two).unwrap();
        assert!(write_together(&[(&one, b"1"), (&two, b"2")]).is_err());
        assert!(!one.exists());
        std::fs::remove_dir(&two).unwrap();
        write_together(&[(&one, b"1"), (&two, b"2")]).unwrap();
        assert_eq!(std::fs::read(&one).unwrap(), b"1");
        assert_eq!(std::fs::read(&two).unwrap(), b"2");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_followed_and_stays_and_one_to_nothing_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("deep")).unwrap();
        std::fs::write(at("deep/file"), "old").unwrap();
        std::os::unix::fs::symlink("deep/file", at("link")).unwrap();
        std::os::unix::fs::symlink("link", at("chain")).unwrap();
        write(&at("chain"), b"new").unwrap();
        assert_eq!(std::fs::read(at("deep/file")).unwrap(), b"new");
        assert!(at("link").is_symlink() && at("chain").is_symlink());
        std::os::unix::fs::symlink("nothing", at("dangling")).unwrap();
        let message = write(&at("dangling"), b"new").unwrap_err().to_string();
        assert!(message.contains("not there"), "{message}");
        assert!(!at("nothing").exists());
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_is_refused_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("folder")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        std::os::unix::fs::symlink("socket", at("link")).unwrap();
        for (name, word) in [
            ("folder", "a folder"),
            ("socket", "a socket"),
            ("link", "a socket"),
        ] {
            let before = std::fs::symlink_metadata(at(name)).unwrap().file_type();
            let message = write(&at(name), b"new").unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
            assert_eq!(
                std::fs::symlink_metadata(at(name)).unwrap().file_type(),
                before
            );
        }
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
