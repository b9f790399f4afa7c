//! Temporary files and folders of this process, in one list, so that an interrupt leaves none of them behind.
//!
//! A temporary is made, gets its final name and is removed under one lock. Whoever ends the process calls
//! [`remove_all`], which takes the lock for good: no thread can make another one, or name a half of one, after that.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::{NamedTempFile, TempDir};

/// Prefix of the name of every temporary.
pub const PREFIX: &str = ".stylus-";

/// Ending of a folder's name while it is removed.
const GONE: &str = "-gone";

/// A path that is removed when the process is interrupted.
#[derive(PartialEq)]
enum Entry {
    File(PathBuf),
    Folder(PathBuf),
    /// A folder that was made for the result; removed only if it is empty.
    Made(PathBuf),
}

static LIST: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

fn lock() -> MutexGuard<'static, Vec<Entry>> {
    LIST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Proof that all temporaries are removed; while it lives, no thread makes or names another.
pub struct Removed {
    _list: MutexGuard<'static, Vec<Entry>>,
}

/// Removes all temporaries of this process. The process is to end before the returned value is dropped.
pub fn remove_all() -> Removed {
    let mut list = lock();
    for entry in list.drain(..).rev() {
        // The process ends in any case; what cannot be removed has no one to be told to.
        let _ = match entry {
            Entry::File(path) => fs::remove_file(path),
            Entry::Folder(path) => remove_under_another_name(&path),
            Entry::Made(path) => fs::remove_dir(path),
        };
    }
    Removed { _list: list }
}

/// Waits while an interrupt ends the process, so that nothing is said of what the interrupt has broken off.
pub fn wait_for_an_interrupt() {
    drop(lock());
}

/// Runs `work`, which gives results their names, without an interrupt in between. `work` must not use temporaries.
pub fn undisturbed<T>(work: impl FnOnce() -> T) -> T {
    let _list = lock();
    work()
}

/// Removes a folder to which other threads may still write: they do not find it under its other name. So nothing that
/// is written to a temporary folder may make the folders above it.
fn remove_under_another_name(path: &Path) -> io::Result<()> {
    let mut other = path.as_os_str().to_owned();
    other.push(GONE);
    let other = PathBuf::from(other);
    fs::rename(path, &other)?;
    fs::remove_dir_all(&other)
}

fn forget(list: &mut Vec<Entry>, entry: &Entry) {
    if let Some(place) = list.iter().rposition(|listed| listed == entry) {
        list.remove(place);
    }
}

/// The operating system's own reason of a failure, without the temporary's path, which a user has not named.
fn without_its_path(failure: io::Error) -> io::Error {
    let text = failure.to_string();
    match text.split_once(" at path ") {
        Some((reason, _)) => io::Error::new(failure.kind(), reason),
        None => failure,
    }
}

/// Checks that a file can be made in `folder`, by one without a name.
///
/// # Errors
/// The operating system's reason.
pub fn try_in(folder: &Path) -> io::Result<()> {
    tempfile::tempfile_in(folder)
        .map(drop)
        .map_err(without_its_path)
}

/// A temporary file, which is removed when it is dropped.
pub struct TemporaryFile {
    file: Option<NamedTempFile>,
}

impl TemporaryFile {
    /// Makes a file in `folder` with the permissions of an ordinary one: the process's umask takes its share.
    ///
    /// # Errors
    /// The operating system's reason.
    pub fn new_in(folder: &Path) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        // A temporary file would be its owner's alone.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut list = lock();
        let file = builder.tempfile_in(folder).map_err(without_its_path)?;
        list.push(Entry::File(file.path().to_owned()));
        Ok(Self { file: Some(file) })
    }

    /// The file.
    pub fn as_file(&self) -> &File {
        self.named().as_file()
    }

    /// The file, to be written.
    pub fn as_file_mut(&mut self) -> &mut File {
        let file = self.file.as_mut();
        file.expect("it is taken at its end only").as_file_mut()
    }

    fn named(&self) -> &NamedTempFile {
        self.file.as_ref().expect("it is taken at its end only")
    }

    /// Gives the file its name, where it replaces another. The temporary is removed if it cannot get it.
    ///
    /// # Errors
    /// The operating system's reason.
    pub fn persist(mut self, path: &Path) -> io::Result<()> {
        let mut list = lock();
        let Some(file) = self.file.take() else {
            return Ok(());
        };
        forget(&mut list, &Entry::File(file.path().to_owned()));
        let named = file.persist(path);
        named.map(drop).map_err(|failure| failure.error)
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            let mut list = lock();
            forget(&mut list, &Entry::File(file.path().to_owned()));
            drop(file);
        }
    }
}

/// A temporary folder, which is removed with all that is in it when it is dropped.
pub struct TemporaryFolder {
    folder: Option<TempDir>,
    path: PathBuf,
}

impl TemporaryFolder {
    /// Makes a folder in `folder` with the permissions of an ordinary one.
    ///
    /// # Errors
    /// The operating system's reason.
    pub fn new_in(folder: &Path) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
        let mut list = lock();
        let folder = builder.tempdir_in(folder).map_err(without_its_path)?;
        let path = folder.path().to_owned();
        list.push(Entry::Folder(path.clone()));
        Ok(Self {
            folder: Some(folder),
            path,
        })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// The operating system's reason; the folder is then removed.
    pub fn persist(mut self, path: &Path) -> io::Result<()> {
        let mut list = lock();
        let named = fs::rename(&self.path, path);
        if named.is_ok() {
            forget(&mut list, &Entry::Folder(self.path.clone()));
            let _ = self.folder.take().map(TempDir::keep);
        }
        // Dropping it takes the lock.
        drop(list);
        named
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        if let Some(folder) = self.folder.take() {
            let mut list = lock();
            forget(&mut list, &Entry::Folder(self.path.clone()));
            drop(folder);
        }
    }
}

/// Folders that were made on the way to a result. They are removed, if they are empty, unless they are kept.
#[derive(Default)]
pub struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    /// Makes `folder` and those above it that are missing.
    ///
    /// # Errors
    /// The operating system's reason.
    pub fn make(folder: &Path) -> io::Result<Self> {
        let mut missing = Vec::new();
        let mut above = Some(folder);
        while let Some(path) = above.filter(|path| !path.as_os_str().is_empty() && !path.exists()) {
            missing.push(path.to_owned());
            above = path.parent();
        }
        let mut made = Self::default();
        for path in missing.into_iter().rev() {
            let mut list = lock();
            fs::create_dir(&path)?;
            list.push(Entry::Made(path.clone()));
            made.0.push(path);
        }
        Ok(made)
    }

    /// The folders, the one above before the one in it.
    pub fn paths(&self) -> &[PathBuf] {
        &self.0
    }

    /// Keeps the folders.
    pub fn keep(mut self) {
        let mut list = lock();
        for path in self.0.drain(..) {
            forget(&mut list, &Entry::Made(path));
        }
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        if self.0.is_empty() {
            return;
        }
        let mut list = lock();
        for path in self.0.drain(..).rev() {
            let _ = fs::remove_dir(&path);
            forget(&mut list, &Entry::Made(path));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn what_is_dropped_is_removed_and_what_is_named_stays() {
        let folder = tempfile::tempdir().unwrap();
        drop(TemporaryFile::new_in(folder.path()).unwrap());
        let dropped = TemporaryFolder::new_in(folder.path()).unwrap();
        fs::write(dropped.path().join("a"), "").unwrap();
        drop(dropped);
        assert_eq!(names(folder.path()), 0);
        let file = TemporaryFile::new_in(folder.path()).unwrap();
        file.persist(&folder.path().join("file")).unwrap();
        let kept = TemporaryFolder::new_in(folder.path()).unwrap();
        kept.persist(&folder.path().join("kept")).unwrap();
        assert!(folder.path().join("kept").is_dir());
        assert_eq!(names(folder.path()), 2);
    }

    #[test]
    fn folders_on_the_way_are_removed_unless_kept_or_filled() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("a/b/c");
        drop(MadeFolders::make(&deep).unwrap());
        assert_eq!(names(folder.path()), 0);
        let made = MadeFolders::make(&deep).unwrap();
        fs::write(folder.path().join("a/mine"), "").unwrap();
        drop(made);
        assert!(folder.path().join("a").is_dir() && !folder.path().join("a/b").exists());
        MadeFolders::make(&deep).unwrap().keep();
        assert!(deep.is_dir());
    }

    #[test]
    fn a_failure_does_not_name_the_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let failure = TemporaryFile::new_in(&folder.path().join("nowhere")).err();
        let message = failure.unwrap().to_string();
        assert!(!message.contains(PREFIX), "{message}");
    }
}
