//! Announcements of virtual styluses, in the user's runtime folder, so that other programs find them.
//!
//! A file has the virtual time of one virtual stylus in its first line, and one of its links in each further line. The
//! file is locked as long as the virtual stylus runs, so that a killed one is not found.

use std::env;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

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
        Self::within(&own_folder()?, links)
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
    own_folder().map_or_else(|_| Vec::new(), |folder| announced_in(&folder))
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

/// Name of the folder in the user's runtime folder.
const FOLDER: &str = "stylus";

/// Permission bits of everyone but the owner.
#[cfg(unix)]
const OTHERS: u32 = 0o077;

/// Returns the folder, and creates it if necessary. It is in `XDG_RUNTIME_DIR`; otherwise it is `.stylus` in the user's
/// home; otherwise it is in the temporary folder, under a name with the user's number. On Unix the folder belongs to
/// this user, and nobody else may enter it.
///
/// # Errors
/// A folder that cannot be created, that belongs to another user, or that others may enter.
fn own_folder() -> io::Result<PathBuf> {
    let runtime = env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let temporary = env::temp_dir().join(temporary_name()?);
    first_of(runtime.as_deref(), env::home_dir().as_deref(), &temporary)
}

fn first_of(runtime: Option<&Path>, home: Option<&Path>, temporary: &Path) -> io::Result<PathBuf> {
    // Either folder may be missing, or may belong to another user if a command runs as root. Unlike in the temporary
    // folder, nobody else can take a name in them.
    let is_usable = |folder: &&Path| folder.is_absolute() && is_own(folder);
    let runtime = runtime.filter(is_usable).map(|folder| folder.join(FOLDER));
    let home = (home.filter(is_usable)).map(|folder| folder.join(format!(".{FOLDER}")));
    let mut private_ones = [runtime, home].into_iter().flatten().map(|folder| private(&folder));
    match private_ones.find_map(Result::ok) {
        Some(folder) => Ok(folder),
        None => private(temporary),
    }
}

#[cfg(unix)]
fn temporary_name() -> io::Result<String> {
    Ok(format!("{FOLDER}-{}", user()?))
}

#[cfg(not(unix))]
fn temporary_name() -> io::Result<String> {
    Ok(FOLDER.to_owned())
}

/// Returns the number of this user, which owns any file that this process creates.
#[cfg(unix)]
fn user() -> io::Result<u32> {
    use std::os::unix::fs::MetadataExt;
    Ok(tempfile::tempfile()?.metadata()?.uid())
}

#[cfg(unix)]
fn is_own(folder: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let owner = folder.metadata().map(|metadata| metadata.uid());
    matches!((owner, user()), (Ok(owner), Ok(user)) if owner == user)
}

#[cfg(not(unix))]
fn is_own(folder: &Path) -> bool {
    folder.is_dir()
}

/// Creates the folder if it does not exist. Returns it if it belongs to this user and nobody else may enter it.
#[cfg(unix)]
fn private(folder: &Path) -> io::Result<PathBuf> {
    use std::os::unix::fs::{DirBuilderExt, MetadataExt};
    match std::fs::DirBuilder::new().mode(0o700).create(folder) {
        Err(failure) if failure.kind() != io::ErrorKind::AlreadyExists => {
            return Err(io::Error::new(
                failure.kind(),
                format!("{}: {failure}", folder.display()),
            ));
        }
        _ => {}
    }
    // A link may lead anywhere, so it is not followed.
    let found = folder.symlink_metadata()?;
    if found.is_dir() && found.uid() == user()? && found.mode() & OTHERS == 0 {
        return Ok(folder.to_owned());
    }
    Err(io::Error::other(format!(
        "{} is not a folder of yours that nobody else may enter: remove it",
        folder.display()
    )))
}

#[cfg(not(unix))]
fn private(folder: &Path) -> io::Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    Ok(folder.to_owned())
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

    /// The folder of the announcements, whose owner and permissions are checked on Unix.
    #[cfg(unix)]
    mod folder {
        use std::fs::{Permissions, create_dir, set_permissions};
        use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};

        use super::*;

        #[test]
        fn a_name_that_another_user_took_in_the_temporary_folder_keeps_nobody_out() {
            let bench = tempfile::tempdir().unwrap();
            let at = |name: &str| bench.path().join(name);
            for name in ["runtime", "home"] {
                create_dir(at(name)).unwrap();
            }
            // A folder of another user could not be entered or removed. A file stands for it here, because it is as
            // useless.
            std::fs::write(at("temporary"), "").unwrap();
            let (runtime, home, temporary) = (at("runtime"), at("home"), at("temporary"));
            let first = |runtime: Option<&Path>, home| first_of(runtime, home, &temporary).ok();
            assert_eq!(first(Some(&runtime), Some(&home)), Some(runtime.join("stylus")));
            assert_eq!(first(Some(&at("gone")), Some(&home)), Some(home.join(".stylus")));
            assert_eq!(first(None, Some(&home)), Some(home.join(".stylus")));
            assert_eq!(first(None, None), None);
        }

        #[test]
        fn a_folder_that_others_may_enter_or_that_is_a_link_is_refused() {
            let bench = tempfile::tempdir().unwrap();
            let own = bench.path().join("own");
            assert_eq!(private(&own).unwrap(), own);
            assert_eq!(own.metadata().unwrap().mode() & 0o777, 0o700);
            assert_eq!(private(&own).unwrap(), own);
            let open = bench.path().join("open");
            create_dir(&open).unwrap();
            set_permissions(&open, Permissions::from_mode(0o750)).unwrap();
            let link = bench.path().join("link");
            symlink(&own, &link).unwrap();
            let file = bench.path().join("file");
            std::fs::write(&file, "").unwrap();
            for folder in [open, link, file] {
                let message = private(&folder).unwrap_err().to_string();
                assert!(message.contains("remove it"), "{message}");
            }
        }
    }
}
