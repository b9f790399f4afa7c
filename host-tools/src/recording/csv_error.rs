//! Failures of the CSV reader in words, with the line.

use std::path::Path;

use crate::support::error::Error;

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
