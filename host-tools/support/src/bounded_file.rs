//! Files that are read whole, up to a size limit. No length that a file states is trusted: the bytes are counted while
//! they are read, so that only existing data takes memory, even if a file has no end.

use std::ffi::OsStr;
use std::io::{self, Read};
use std::path::Path;

use super::files::{self, Opened};
use super::names::nearly;
use crate::{Error, Result};

/// Largest number of names in a folder that are compared with the name of a missing file.
const MOST_NAMES: usize = 10_000;

/// Makes the list of formats, in which none lacks its limit, so that whoever goes through [`Format::ALL`] misses none.
macro_rules! formats {
    ($($(#[$doc:meta])* $name:ident: $of:literal, $mebibytes:literal;)*) => {
        /// A format of files that the host reads. Each has a size limit.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Format {
            $($(#[$doc])* $name,)*
        }

        impl Format {
            /// All formats.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// Returns the name of the format, with its article, and the largest size of a file, bytes.
            fn limit(self) -> (&'static str, u64) {
                match self {
                    $(Self::$name => ($of, $mebibytes << 20),)*
                }
            }
        }
    };
}

formats! {
    /// Samples as WAV, whose length is stated in 32 bits.
    Wave: "a recording", 4097;
    /// Samples as CSV.
    Table: "a table of samples", 512;
    /// Samples of LabVIEW.
    LabView: "a LabVIEW file", 512;
    /// Samples of a free hand with its motion, as CSV.
    Strokes: "a free hand's recording", 512;
    /// Trials of a recording set, as CSV.
    Trials: "a list of trials", 512;
    /// Trials to be recorded, as CSV.
    Plan: "a list of trials to record", 512;
    /// A motion as CSV: about 40 bytes per row, so that a day at 100 rows per second fits.
    Motion: "a motion", 512;
    /// Answers of a listening test, as CSV.
    Answers: "a file of answers", 16;
    /// A scene, as TOML.
    Scene: "a scene", 1;
    /// The description of a rig, as TOML.
    Rig: "a rig's description", 1;
    /// A model file of HaTT, as XML. The published ones take some hundred kilobytes.
    Hatt: "a HaTT model file", 16;
    /// A library. A slot holds half a mebibyte; for slightly larger files the decoder's error names the lengths.
    Library: "a library", 16;
    /// The record of a fit, as JSON: some hundred bytes per trial, of which a list has up to 100 000.
    Record: "a fit's record", 512;
    /// A partial result of a fit: some 4 KB for each trial of a unit.
    Partial: "a partial result", 1024;
    /// An update of the device.
    Update: "an update", 1;
    /// The list of a result's files: enough for about 100 000 files.
    Listing: "a list of a result's files", 16;
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
        files::entries(folder)
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| entry.name.into_string().ok())
            .take(MOST_NAMES)
            .collect::<Vec<_>>()
    };
    // Only the name of a file that is missing may be misspelt.
    let wanted = wanted.filter(|_| source.kind() == io::ErrorKind::NotFound);
    let source = match wanted.and_then(|wanted| Some(nearly(wanted, &there())?.to_owned())) {
        Some(name) => io::Error::new(source.kind(), format!("{source}; did you mean '{name}'?")),
        None => source,
    };
    Error::io(action, path)(source)
}

impl Format {
    /// Opens the file at `path`. It must be a regular file within the size limit, because it is read more than once or
    /// not in sequence. Devices and pipes are refused before they are opened.
    pub fn open(self, path: &Path) -> Result<Opened> {
        // To open a pipe would mean to wait for its other end.
        let found = files::found(path).map_err(|source| absent("open", path, source))?;
        let (of, _) = self.limit();
        if let Some(other) = found.other {
            let problem = format!("is {other}, and {of} is read from a file: copy it to one");
            return Err(Error::file(path, problem));
        }
        self.admit(path, found.len)?;
        files::open(path).map_err(Error::io("open", path))
    }

    /// Returns an error if a file of `size` bytes is larger than its limit.
    pub fn admit(self, path: &Path, size: u64) -> Result<()> {
        if size > self.limit().1 {
            return Err(self.exceeded(path));
        }
        Ok(())
    }

    fn exceeded(self, path: &Path) -> Error {
        let (of, most) = self.limit();
        let problem = format!("has more than {most} bytes, the most of {of}: give another file, or a part of it");
        Error::file(path, problem)
    }

    /// Reads the file at `path`.
    pub fn read(self, path: &Path) -> Result<Vec<u8>> {
        // On Unix a folder can be opened, and reading it fails with words that name no remedy.
        let (of, most) = self.limit();
        if files::is_dir(path) {
            let problem = format!("is a folder, and {of} is read from a file: name one");
            return Err(Error::file(path, problem));
        }
        let file = files::open(path).map_err(|source| absent("read", path, source))?;
        let mut bytes = Vec::new();
        // One byte more than allowed is enough to know that there are too many.
        let mut counted = file.take(most + 1);
        counted.read_to_end(&mut bytes).map_err(Error::io("read", path))?;
        if bytes.len() as u64 > most {
            return Err(self.exceeded(path));
        }
        Ok(bytes)
    }

    /// Reads the text file at `path`.
    pub fn read_text(self, path: &Path) -> Result<String> {
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

    const SMALL: Format = Format::Scene;

    /// Makes the file one byte longer than [`SMALL`] may be.
    fn make_too_long(path: &Path) {
        std::fs::File::create(path)
            .unwrap()
            .set_len(SMALL.limit().1 + 1)
            .unwrap();
    }

    #[test]
    fn a_file_up_to_its_limit_is_read_and_a_larger_one_is_named_with_it() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "four").unwrap();
        assert_eq!(SMALL.read_text(file.path()).unwrap(), "four");
        make_too_long(file.path());
        holds(&SMALL.read(file.path()).unwrap_err(), &["1048576 bytes", "a scene"]);
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
        holds(&SMALL.read(folder.path()).unwrap_err(), &["is a folder", "a scene"]);
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
        make_too_long(&file);
        holds(&SMALL.open(&file).unwrap_err(), &["1048576 bytes"]);
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
