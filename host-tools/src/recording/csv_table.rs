//! Tables as CSV: their conventions, their header, and failures of the reader in words, with the line.

use std::io::Read;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::support::error::{Error, Result};

/// Reader of a table: comments begin with `#`, and spaces around a field do not count.
pub(crate) fn csv_table() -> ReaderBuilder {
    let mut builder = ReaderBuilder::new();
    builder.comment(Some(b'#')).trim(Trim::All);
    builder
}

/// Reads the header of the table at `path`.
pub(crate) fn csv_header(path: &Path, reader: &mut csv::Reader<impl Read>) -> Result<StringRecord> {
    let header = reader.headers();
    header.cloned().map_err(|failure| csv_error(path, failure))
}

/// Converts a failure of the CSV reader, with its line.
pub(crate) fn csv_error(path: &Path, failure: csv::Error) -> Error {
    let line = failure.position().map_or(0, csv::Position::line);
    match failure.into_kind() {
        csv::ErrorKind::Io(source) => Error::io("read", path)(source),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => Error::line(
            path,
            line,
            format!("{len} fields where the first line has {expected_len}"),
        ),
        csv::ErrorKind::Utf8 { .. } => {
            Error::line(path, line, "is not UTF-8 text: save the file as UTF-8")
        }
        other => Error::line(path, line, format!("{other:?}")),
    }
}
