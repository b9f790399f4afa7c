//! Temporary files and folders of this process, in one list, so that an interrupt leaves none of them behind.
//!
//! A temporary is created, renamed and removed under one lock. Code that ends the process calls [`remove_all`], which
//! takes the lock permanently: after that, no thread can create another temporary, or rename an incomplete one.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Prefix of the name of every temporary.
pub const PREFIX: &str = ".stylus-";

static LIST: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn lock() -> MutexGuard<'static, Vec<PathBuf>> {
    // A panic of another thread leaves the list whole.
    LIST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Proof that all temporaries are removed. While this value exists, no thread creates or renames a temporary.
pub struct Removed {
    _list: MutexGuard<'static, Vec<PathBuf>>,
}

/// Removes all temporaries of this process. The process must end before the returned value is dropped.
pub fn remove_all() -> Removed {
    let mut list = lock();
    for path in list.drain(..) {
        remove(&path);
    }
    Removed { _list: list }
}

/// Waits while an interrupt ends the process, so that failures caused by the interrupt are not reported.
pub fn wait_for_an_interrupt() {
    drop(lock());
}

/// Removes a temporary. A folder is renamed first, so that other threads that may still write to it do not find it. A
/// failure is ignored, because there is nobody to whom it could be reported.
fn remove(path: &Path) {
    if path.is_dir() {
        let mut gone = path.as_os_str().to_owned();
        gone.push("-gone");
        let gone = PathBuf::from(gone);
        let _ = fs::rename(path, &gone).and_then(|()| fs::remove_dir_all(&gone));
    } else {
        let _ = fs::remove_file(path);
    }
}

/// Returns the operating system's reason for a failure, without the path of the temporary, which the user did not name.
fn without_its_path(failure: io::Error) -> io::Error {
    let text = failure.to_string();
    // tempfile writes the path after the reason in this form.
    match text.split_once(" at path ") {
        Some((reason, _)) => io::Error::new(failure.kind(), reason),
        None => failure,
    }
}

/// Checks that a file can be created in `folder`, with a file that has no name.
pub(crate) fn try_in(folder: &Path) -> io::Result<()> {
    let made = tempfile::tempfile_in(folder);
    made.map(drop).map_err(without_its_path)
}

/// A temporary file or folder. It is removed with all its content when it is dropped.
pub struct Temporary {
    path: PathBuf,
}

impl Temporary {
    /// Creates a file in `folder` with these permissions, or with those of an ordinary file. The process's umask
    /// restricts them further.
    #[cfg_attr(not(unix), expect(unused_variables, reason = "permissions are those of the folder"))]
    pub fn file_in(folder: &Path, permissions: Option<fs::Permissions>) -> io::Result<(Self, File)> {
        let builder = &mut tempfile::Builder::new();
        // By default, only its owner could open a temporary file.
        #[cfg(unix)]
        builder.permissions(permissions.unwrap_or(std::os::unix::fs::PermissionsExt::from_mode(0o666)));
        let mut list = lock();
        let made = builder.prefix(PREFIX).tempfile_in(folder);
        // From here on this list, and not tempfile, removes it.
        let (file, path) = made.map_err(without_its_path)?.keep()?;
        list.push(path.clone());
        Ok((Self { path }, file))
    }

    /// Creates a folder in `folder` with the permissions of an ordinary folder.
    pub fn folder_in(folder: &Path) -> io::Result<Self> {
        let builder = &mut tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
        let mut list = lock();
        let made = builder.prefix(PREFIX).tempdir_in(folder);
        let path = made.map_err(without_its_path)?.keep();
        list.push(path.clone());
        Ok(Self { path })
    }

    /// Path of the temporary.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Renames the temporary to its final name, `path`. A file replaces an existing file. A folder at `path` is first
    /// moved to `aside`; no interrupt can happen between the two steps.
    ///
    /// # Errors
    /// The operating system's reason; the temporary is then removed, and the folder moved back.
    pub fn persist(self, path: &Path, aside: Option<&Path>) -> io::Result<()> {
        let mut list = lock();
        let moved = aside.map_or(Ok(()), |aside| fs::rename(path, aside));
        let named = moved.and_then(|()| {
            fs::rename(&self.path, path).inspect_err(|_| {
                // If this fails, too, the first failure is still what the user can do something about.
                let _ = aside.map(|aside| fs::rename(aside, path));
            })
        });
        if named.is_ok() {
            list.retain(|listed| *listed != self.path);
        }
        // Dropping `self` takes the lock.
        drop(list);
        named
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut list = lock();
        if let Some(place) = list.iter().position(|listed| *listed == self.path) {
            list.swap_remove(place);
            remove(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_is_removed_and_what_is_named_stays() {
        let folder = tempfile::tempdir().unwrap();
        let names = || fs::read_dir(folder.path()).unwrap().count();
        drop(Temporary::file_in(folder.path(), None).unwrap());
        let dropped = Temporary::folder_in(folder.path()).unwrap();
        fs::write(dropped.path().join("a"), "").unwrap();
        drop(dropped);
        assert_eq!(names(), 0);
        let (file, _) = Temporary::file_in(folder.path(), None).unwrap();
        file.persist(&folder.path().join("file"), None).unwrap();
        let kept = Temporary::folder_in(folder.path()).unwrap();
        kept.persist(&folder.path().join("kept"), None).unwrap();
        assert!(folder.path().join("kept").is_dir());
        assert_eq!(names(), 2);
    }

    #[test]
    fn what_cannot_be_replaced_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let [path, aside] = ["result", "aside"].map(|name| folder.path().join(name));
        fs::create_dir(&path).unwrap();
        fs::write(path.join("earlier"), "").unwrap();
        let new = Temporary::folder_in(folder.path()).unwrap();
        fs::remove_dir(new.path()).unwrap();
        new.persist(&path, Some(&aside)).unwrap_err();
        assert!(path.join("earlier").is_file() && !aside.exists());
    }

    #[test]
    fn a_failure_does_not_name_the_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let failure = Temporary::file_in(&folder.path().join("nowhere"), None).err();
        let message = failure.unwrap().to_string();
        assert!(!message.contains(PREFIX), "{message}");
    }
}
