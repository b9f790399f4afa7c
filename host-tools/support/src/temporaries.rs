//! Temporary files and folders of this process, in one list, so that an interrupt leaves none of them behind.
//!
//! A temporary is created, renamed and removed under one lock. Code that ends the process calls [`remove_all`], which
//! takes the lock permanently: after that, no thread can create another temporary, or rename an incomplete one.

use std::ffi::{OsStr, OsString};
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
    tempfile::tempfile_in(folder).map(drop).map_err(without_its_path)
}

/// A temporary file or folder. It is removed with all its content when it is dropped.
pub struct Temporary {
    path: PathBuf,
}

impl Temporary {
    /// Creates a file in `folder` with these permissions, or with those of an ordinary file. The process's umask
    /// restricts them further.
    #[cfg_attr(
        not(unix),
        expect(
            unused_variables,
            clippy::needless_pass_by_value,
            reason = "permissions are those of the folder"
        )
    )]
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

    /// Renames the temporary to its final name, `path`, in place of what `earlier` says.
    ///
    /// # Errors
    /// The operating system's reason; the temporary is then removed, and what was at `path` stays there.
    pub fn persist(self, path: &Path, earlier: Earlier) -> io::Result<()> {
        let mut list = lock();
        let named = match earlier {
            Earlier::Nothing => rename_to_free(&self.path, path),
            Earlier::File => fs::rename(&self.path, path),
            Earlier::Folder => exchange(&self.path, path),
        };
        // An earlier folder now has the temporary's name, and is removed as the temporary would be.
        if named.is_ok() && earlier != Earlier::Folder {
            list.retain(|listed| *listed != self.path);
        }
        // Dropping `self` takes the lock.
        drop(list);
        named
    }
}

/// What a temporary may replace at its final name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Earlier {
    /// Nothing: the name must still be free.
    Nothing,
    /// A file, or nothing.
    File,
    /// A folder, which must be there.
    Folder,
}

/// Renames `from` to `to` if nothing is there.
fn rename_to_free(from: &Path, to: &Path) -> io::Result<()> {
    match rename_at_once(from, to, Earlier::Nothing) {
        Err(failure) if is_unsupported(&failure) => {}
        renamed => return renamed,
    }
    // A link to a file fails if the name is taken. A folder has none, but is never renamed onto one with files.
    if from.is_file() {
        fs::hard_link(from, to)?;
        return fs::remove_file(from);
    }
    fs::rename(from, to)
}

/// Exchanges the folders `new` and `old`.
fn exchange(new: &Path, old: &Path) -> io::Result<()> {
    match rename_at_once(new, old, Earlier::Folder) {
        Err(failure) if is_unsupported(&failure) => exchange_by_steps(new, old),
        exchanged => exchanged,
    }
}

/// Exchanges the folders `new` and `old` where the file system cannot do it at once. If the process is killed in
/// between, [`left_aside`] finds the earlier folder.
fn exchange_by_steps(new: &Path, old: &Path) -> io::Result<()> {
    let mut aside = new.as_os_str().to_owned();
    aside.push(ending_aside(old));
    let aside = PathBuf::from(aside);
    fs::rename(old, &aside)?;
    if let Err(failure) = fs::rename(new, old) {
        // If this fails, too, the first failure is still what the user can do something about.
        let _ = fs::rename(&aside, old);
        return Err(failure);
    }
    fs::rename(aside, new)
}

/// Ending of the name that a folder named like `path` has while it is exchanged by steps.
fn ending_aside(path: &Path) -> OsString {
    let mut ending = OsString::from("-earlier-");
    ending.push(path.file_name().unwrap_or_default());
    ending
}

/// Folder of the file at `path`.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Returns where the earlier folder of the name `path` is, if a process was killed as it replaced it.
pub fn left_aside(path: &Path) -> Option<PathBuf> {
    let ending = ending_aside(path);
    let is_aside = |name: &OsStr| {
        let name = name.as_encoded_bytes();
        name.starts_with(PREFIX.as_bytes()) && name.ends_with(ending.as_encoded_bytes())
    };
    let mut entries = fs::read_dir(folder_of(path)).ok()?.flatten();
    entries
        .find(|entry| is_aside(&entry.file_name()))
        .map(|entry| entry.path())
}

fn is_unsupported(failure: &io::Error) -> bool {
    matches!(failure.kind(), io::ErrorKind::Unsupported | io::ErrorKind::InvalidInput)
}

/// Renames `from` to `to` in one step, which fails if the name is taken, or exchanges both.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn rename_at_once(from: &Path, to: &Path, earlier: Earlier) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    let flags = match earlier {
        Earlier::Folder => RenameFlags::EXCHANGE,
        _ => RenameFlags::NOREPLACE,
    };
    Ok(renameat_with(CWD, from, CWD, to, flags)?)
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn rename_at_once(_: &Path, _: &Path, _: Earlier) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
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
        file.persist(&folder.path().join("file"), Earlier::Nothing).unwrap();
        let kept = Temporary::folder_in(folder.path()).unwrap();
        kept.persist(&folder.path().join("kept"), Earlier::Nothing).unwrap();
        assert!(folder.path().join("kept").is_dir());
        assert_eq!(names(), 2);
    }

    #[test]
    fn folders_are_exchanged_and_what_cannot_be_replaced_stays() {
        for exchange in [exchange, exchange_by_steps] {
            let folder = tempfile::tempdir().unwrap();
            let [new, old] = [".stylus-new", "result"].map(|name| folder.path().join(name));
            fs::create_dir(&old).unwrap();
            fs::write(old.join("earlier"), "").unwrap();
            exchange(&new, &old).unwrap_err();
            assert!(old.join("earlier").is_file());
            fs::create_dir(&new).unwrap();
            exchange(&new, &old).unwrap();
            assert!(new.join("earlier").is_file() && !old.join("earlier").exists());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        }
    }

    #[test]
    fn a_name_that_was_taken_meanwhile_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result");
        fs::write(&path, "another's").unwrap();
        let (new, _) = Temporary::file_in(folder.path(), None).unwrap();
        let failure = new.persist(&path, Earlier::Nothing).unwrap_err();
        assert_eq!(failure.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).unwrap(), b"another's");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_was_left_aside_is_found_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let aside = folder.path().join(".stylus-a1-earlier-out");
        fs::create_dir(&aside).unwrap();
        assert_eq!(left_aside(&folder.path().join("out")), Some(aside));
        assert_eq!(left_aside(&folder.path().join("outer")), None);
    }

    #[test]
    fn a_failure_does_not_name_the_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let message = Temporary::file_in(&folder.path().join("nowhere"), None)
            .err()
            .unwrap()
            .to_string();
        assert!(!message.contains(PREFIX), "{message}");
    }
}
