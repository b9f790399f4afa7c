//! Files that are read whole, up to a size limit. No length that a file states is trusted: the bytes are counted while
//! they are read, so that only existing data takes memory, even if a file has no end.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use super::atomic_file::other_than_a_file;
use super::error::{Error, Result};
use super::nearest::nearly;

/// One mebibyte, bytes.
pub const MIB: u64 = 1 << 20;

/// Largest number of names in a folder that are compared with the name of a missing file.
const MOST_NAMES: usize = 10_000;

/// A kind of file, with its size limit.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    /// Name of the kind, with its article.
    pub of: &'static str,
    /// Largest size, bytes.
    pub bytes: u64,
}

/// Returns the error that `action` failed on the file at `path`. If the file is missing, the error suggests a file in
/// the same folder with a similar name.
pub fn absent(action: &'static str, path: &Path, source: io::Error) -> Error {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let wanted = path.file_name().and_then(OsStr::to_str);
    let there = || {
        let names = fs::read_dir(folder).into_iter().flatten().flatten();
        let names = names.filter_map(|entry| entry.file_name().into_string().ok());
        names.take(MOST_NAMES).collect::<Vec<_>>()
    };
    // Only the name of a file that is missing may be misspelt.
    let wanted = wanted.filter(|_| source.kind() == io::ErrorKind::NotFound);
    let source = match wanted.and_then(|wanted| Some(nearly(wanted, &there())?.to_owned())) {
        Some(name) => io::Error::new(source.kind(), format!("{source}; did you mean '{name}'?")),
        None => source,
    };
    Error::io(action, path)(source)
}

impl Limit {
    /// Opens the file at `path`. It must be a regular file within the size limit, because it is read more than once or
    /// not in sequence. Devices and pipes are refused before they are opened.
    pub fn open(&self, path: &Path) -> Result<File> {
        // To open a pipe would mean to wait for its other end.
        let found = std::fs::metadata(path).map_err(|source| absent("open", path, source))?;
        if let Some(other) = other_than_a_file(&found) {
            let problem = format!("is {other}, and {} is read from a file: copy it to one", self.of);
            return Err(Error::file(path, problem));
        }
        if found.len() > self.bytes {
            return Err(self.exceeded(path));
        }
        File::open(path).map_err(Error::io("open", path))
    }

    fn exceeded(&self, path: &Path) -> Error {
        let problem = format!(
            "has more than {} bytes, the most of {}: give another file, or a part of it",
            self.bytes, self.of
        );
        Error::file(path, problem)
    }

    /// Reads the file at `path`.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let file = File::open(path).map_err(|source| absent("read", path, source))?;
        // On Unix a folder can be opened, and reading it fails with words that name no remedy.
        if file.metadata().is_ok_and(|found| found.is_dir()) {
            let problem = format!("is a folder, and {} is read from a file: name one", self.of);
            return Err(Error::file(path, problem));
        }
        let mut bytes = Vec::new();
        // One byte more than allowed is enough to know that there are too many.
        let mut counted = file.take(self.bytes + 1);
        counted.read_to_end(&mut bytes).map_err(Error::io("read", path))?;
        if bytes.len() as u64 > self.bytes {
            return Err(self.exceeded(path));
        }
        Ok(bytes)
    }

    /// Reads the text file at `path`.
    pub fn read_text(&self, path: &Path) -> Result<String> {
        String::from_utf8(self.read(path)?).map_err(|failure| {
            let before = &failure.as_bytes()[..failure.utf8_error().valid_up_to()];
            let line = before.split(|&byte| byte == b'\n').count() as u64;
            Error::line(path, line, "is not UTF-8 text: save the file as UTF-8")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    const SMALL: Limit = Limit { of: "a note", bytes: 4 };

    #[test]
    fn a_file_up_to_its_limit_is_read_and_a_larger_one_is_named_with_it() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "four").unwrap();
        assert_eq!(SMALL.read_text(file.path()).unwrap(), "four");
        std::fs::write(file.path(), "five!").unwrap();
        let message = SMALL.read(file.path()).unwrap_err();
        holds(&message, &["4 bytes", "a note"]);
    }

    #[test]
    fn a_file_that_is_not_there_is_compared_with_those_beside_it_and_a_folder_is_told() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("denim_40mms.csv"), "four").unwrap();
        for fails in [
            SMALL.open(&folder.path().join("denim_40mm.csv")).map(drop),
            SMALL.read(&folder.path().join("denim_40mm.csv")).map(drop),
        ] {
            let failure = fails.unwrap_err();
            holds(&failure, &["did you mean 'denim_40mms.csv'?"]);
            let is_absence = |source: &io::Error| source.kind() == io::ErrorKind::NotFound;
            assert!(matches!(failure, Error::Io { source, .. } if is_absence(&source)));
        }
        let other = SMALL.read(&folder.path().join("silk.csv")).unwrap_err();
        assert!(!other.to_string().contains("did you mean"), "{other}");
        holds(&SMALL.read(folder.path()).unwrap_err(), &["is a folder", "a note"]);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_read_in_leaps_is_a_regular_file_within_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("socket");
        let _socket = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        holds(&SMALL.open(&socket).unwrap_err(), &["a socket"]);
        holds(&SMALL.open(folder.path()).unwrap_err(), &["a folder"]);
        let file = folder.path().join("file");
        std::fs::write(&file, "five!").unwrap();
        holds(&SMALL.open(&file).unwrap_err(), &["4 bytes"]);
        std::fs::write(&file, "four").unwrap();
        assert!(SMALL.open(&file).is_ok());
    }

    #[test]
    fn text_of_another_encoding_is_refused_with_its_line() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"a\n\xff").unwrap();
        holds(&SMALL.read_text(file.path()).unwrap_err(), &["line 2"]);
    }
}
