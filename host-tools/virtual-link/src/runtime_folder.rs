//! The user's folder for files that last as long as a process: announcements of virtual styluses.

use std::env;
use std::io;
use std::path::{Path, PathBuf};

/// Name of the folder in the user's runtime folder.
const NAME: &str = "stylus";

/// Permission bits of everyone but the owner.
#[cfg(unix)]
const OTHERS: u32 = 0o077;

/// Returns the folder, and creates it if necessary. It is in `XDG_RUNTIME_DIR`; otherwise it is `.stylus` in the user's
/// home; otherwise it is in the temporary folder, under a name with the user's number. On Unix the folder belongs to
/// this user, and nobody else may enter it.
///
/// # Errors
/// A folder that cannot be created, that belongs to another user, or that others may enter.
pub fn own() -> io::Result<PathBuf> {
    let runtime = env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let temporary = env::temp_dir().join(temporary_name()?);
    first_of(runtime.as_deref(), env::home_dir().as_deref(), &temporary)
}

fn first_of(runtime: Option<&Path>, home: Option<&Path>, temporary: &Path) -> io::Result<PathBuf> {
    // Either folder may be missing, or may belong to another user if a command runs as root. Unlike in the temporary
    // folder, nobody else can take a name in them.
    let is_usable = |folder: &&Path| folder.is_absolute() && is_own(folder);
    let runtime = runtime.filter(is_usable).map(|folder| folder.join(NAME));
    let home = (home.filter(is_usable)).map(|folder| folder.join(format!(".{NAME}")));
    let mut private_ones = [runtime, home].into_iter().flatten().map(|folder| private(&folder));
    match private_ones.find_map(Result::ok) {
        Some(folder) => Ok(folder),
        None => private(temporary),
    }
}

#[cfg(unix)]
fn temporary_name() -> io::Result<String> {
    Ok(format!("{NAME}-{}", user()?))
}

#[cfg(not(unix))]
fn temporary_name() -> io::Result<String> {
    Ok(NAME.to_owned())
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

#[cfg(all(test, unix))]
mod tests {
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
