//! Files that are written whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::support::error::{Error, Result};

/// Writes `path` by way of a temporary file in the same folder, which replaces it after `write` has succeeded.
///
/// An earlier file stays until then, and stays after any failure. Returns the value of `write`.
///
/// # Errors
/// The error of `write`, or a file that cannot be created or replaced.
pub fn write_with<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<T>,
) -> Result<T> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut temporary = tempfile::Builder::new()
        .prefix(".stylus-")
        .tempfile_in(folder)
        .map_err(Error::io("create", path))?;
    let mut buffer = BufWriter::new(temporary.as_file_mut());
    let value = write(&mut buffer)?;
    buffer.flush().map_err(Error::io("write", path))?;
    drop(buffer);
    make_readable(temporary.as_file()).map_err(Error::io("write", path))?;
    temporary
        .persist(path)
        .map_err(|failure| Error::io("replace", path)(failure.error))?;
    Ok(value)
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

/// Gives a file the permissions of an ordinary one, because temporary files are private to their owner.
#[cfg(unix)]
fn make_readable(file: &File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_file: &File) -> std::io::Result<()> {
    Ok(())
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
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }
}
