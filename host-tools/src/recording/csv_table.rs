//! Tables as CSV: their conventions, their header, and failures of the reader in words, with the line.
//!
//! A recording or a list comes from a program that its user did not write. Its separator is a comma, a semicolon, a tab
//! or a space; its decimal sign a point, or a comma where that does not separate; and it may begin with a byte order
//! mark. [`CsvText`] finds these out.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::support::bounded_file::{Limit, MIB};
use crate::support::error::{Error, Result};

/// A table of samples, of trials or of a motion.
pub(crate) const TABLE: Limit = Limit {
    of: "a table",
    bytes: 512 * MIB,
};

/// Separators, in the order of preference.
const SEPARATORS: [char; 4] = [';', '\t', ',', ' '];

/// Text of a table, with its separator and its decimal sign.
pub(crate) struct CsvText {
    text: String,
    separator: char,
    has_decimal_commas: bool,
}

impl CsvText {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be read, is not UTF-8, or is larger than [`TABLE`] says.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        Ok(Self::of(TABLE.read_text(path)?))
    }

    /// Finds the conventions of `text` from its first lines.
    fn of(text: String) -> Self {
        let text = match text.strip_prefix('\u{feff}') {
            Some(rest) => rest.to_owned(),
            None => text,
        };
        let lines = || {
            let content = text.lines().map(str::trim);
            content.filter(|line| !line.is_empty() && !line.starts_with('#'))
        };
        // A line of numbers tells more than a header, whose names may hold spaces.
        let header = lines().next().unwrap_or_default();
        let sample = lines().nth(1).unwrap_or(header);
        let within = |line: &str, separators: &[char]| {
            separators.iter().copied().find(|&s| line.contains(s))
        };
        let separator = within(sample, &SEPARATORS)
            .or_else(|| within(header, &SEPARATORS[..3]))
            .unwrap_or(',');
        let is_decimal = |field: &str| {
            let parts: Vec<&str> = field.trim().split(',').collect();
            let digits =
                |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
            matches!(parts[..], [whole, rest] if digits(whole.trim_start_matches(['+', '-']))
                && rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        let has_decimal_commas = separator != ',' && sample.split(separator).any(is_decimal);
        let text = if separator == ' ' {
            single_spaces(&text)
        } else {
            text
        };
        Self {
            text,
            separator,
            has_decimal_commas,
        }
    }

    /// The text.
    pub(crate) fn as_str(&self) -> &str {
        &self.text
    }

    /// The separator, by name.
    pub(crate) fn separator_name(&self) -> &'static str {
        match self.separator {
            ';' => "semicolon",
            '\t' => "tab",
            ' ' => "space",
            _ => "comma",
        }
    }

    /// Reader of the table, with a header or without.
    pub(crate) fn reader(&self, has_headers: bool) -> csv::Reader<&[u8]> {
        csv_table()
            .has_headers(has_headers)
            .delimiter(self.separator as u8)
            .from_reader(self.text.as_bytes())
    }

    /// Parses a number.
    pub(crate) fn number(&self, field: &str) -> Option<f64> {
        let field = if self.has_decimal_commas {
            Cow::Owned(field.replace(',', "."))
        } else {
            Cow::Borrowed(field)
        };
        field.parse().ok()
    }
}

/// Text with one space between the words of a line.
fn single_spaces(text: &str) -> String {
    let lines = text
        .lines()
        .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    lines.collect::<Vec<_>>().join("\n")
}

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

#[cfg(test)]
mod tests {
    use super::*;

    fn conventions(text: &str) -> (&'static str, bool) {
        let table = CsvText::of(text.to_owned());
        (table.separator_name(), table.has_decimal_commas)
    }

    #[test]
    fn separators_and_decimal_signs_are_found() {
        for (text, expected) in [
            ("a,b\n1.5,2\n", ("comma", false)),
            ("a;b\n1,5;2\n", ("semicolon", true)),
            ("a;b\n1.5;2\n", ("semicolon", false)),
            ("# made, by hand\na\tb\n1,5\t2\n", ("tab", true)),
            ("\u{feff}a;b\n1,5e-3;2\n", ("semicolon", true)),
            ("   5.79e-02\n   5.8e-02\n", ("comma", false)),
            ("0.1 0.2\n0.3 0.4\n", ("space", false)),
            ("1\n2\n", ("comma", false)),
            ("", ("comma", false)),
        ] {
            assert_eq!(conventions(text), expected, "{text:?}");
        }
    }

    #[test]
    fn numbers_are_read_by_the_tables_decimal_sign() {
        let table = CsvText::of("1,5;2\n1,5;2\n".to_owned());
        assert_eq!(table.number("-1,25e-3"), Some(-1.25e-3));
        assert_eq!(table.number("1.250,5"), None);
    }
}
