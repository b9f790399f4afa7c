//! Files that are there whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::support::error::{Error, Result};

/// Writes `path` through a temporary file beside it, which takes its place only when `write` has succeeded.
///
/// Whatever was there before stays until then, and stays if anything fails.
///
/// # Errors
/// What `write` returns, or that the file cannot be made or put in place.
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
/// That the file cannot be made, written or put in place.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| {
        file.write_all(bytes).map_err(Error::io("write", path))
    })
}

/// Temporary files are private to their owner; a result is an ordinary file.
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
