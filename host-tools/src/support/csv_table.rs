//! Tables as CSV: one dialect for every table that a command reads.
//!
//! A table comes from a program that its user did not write. Its separator is a semicolon, a tab, a comma or a space;
//! its decimal sign a point, or a comma where that does not separate; it may begin with a byte order mark, and each
//! line may end with a separator, as spreadsheets write it. Lines from `#` on are comments, empty lines do not count,
//! and spaces around a field do not either. What cannot be read is named with line, column and separator.

use std::borrow::Cow;
use std::cell::Cell;
use std::path::{Path, PathBuf};

use csv::{ReaderBuilder, StringRecord, Trim};

use super::bounded_file::{Limit, MIB};
use super::error::{Error, Result};

/// A table of samples, of trials or of a motion.
pub const TABLE: Limit = Limit {
    of: "a table",
    bytes: 512 * MIB,
};

/// Separators, in the order of preference.
const SEPARATORS: [char; 4] = [';', '\t', ',', ' '];

/// Most characters of a field that an error repeats.
const SHOWN_CHARACTERS: usize = 40;

/// Text of a table, with its separator and its decimal sign.
#[derive(Debug)]
pub struct CsvTable {
    path: PathBuf,
    text: String,
    separator: char,
    /// Decimal sign of the numbers read so far; none before the first that has one.
    decimal_sign: Cell<Option<char>>,
}

impl CsvTable {
    /// Reads the file at `path`, up to `limit`.
    ///
    /// # Errors
    /// A file that cannot be read, is not UTF-8, or is larger than the limit.
    pub fn read(path: &Path, limit: Limit) -> Result<Self> {
        Ok(Self::of(path, limit.read_text(path)?))
    }

    /// Finds the separator of `text` from its first two lines; `path` is only named in errors.
    pub fn of(path: &Path, text: String) -> Self {
        let text = match text.strip_prefix('\u{feff}') {
            Some(rest) => rest.to_owned(),
            None => text,
        };
        let separator = separator_of(&text);
        let text = if separator == ' ' {
            single_spaces(&text)
        } else {
            text
        };
        Self {
            path: path.to_owned(),
            text,
            separator,
            decimal_sign: Cell::new(None),
        }
    }

    /// The text, without a byte order mark.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The file, as errors name it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The first line that is no comment, as names of columns. A table without one has no names.
    ///
    /// # Errors
    /// A line that cannot be read.
    pub fn header(&self) -> Result<Header<'_>> {
        let mut rows = self.rows();
        let (names, line) = match rows.next_row()? {
            Some(row) => (row.fields.clone(), row.line),
            None => (StringRecord::new(), 1),
        };
        Ok(Header {
            table: self,
            names,
            line,
        })
    }

    /// All lines with fields, the header among them.
    pub fn rows(&self) -> Rows<'_> {
        let mut builder = ReaderBuilder::new();
        builder.comment(Some(b'#')).trim(Trim::All);
        builder.has_headers(false).flexible(true);
        Rows {
            table: self,
            reader: builder
                .delimiter(self.separator as u8)
                .from_reader(self.text.as_bytes()),
            record: StringRecord::new(),
            width: None,
        }
    }

    /// The lines below the header.
    ///
    /// # Errors
    /// A header that cannot be read.
    pub fn rows_below_header(&self) -> Result<Rows<'_>> {
        let mut rows = self.rows();
        rows.next_row()?;
        Ok(rows)
    }

    /// Line, from 1, of the row with this index, from 0 at the first row that is no comment. 0 if there is none.
    pub fn line_of_row(&self, index: usize) -> u64 {
        let mut rows = self.rows();
        for _ in 0..index {
            if !matches!(rows.next_row(), Ok(Some(_))) {
                return 0;
            }
        }
        rows.next_row().ok().flatten().map_or(0, |row| row.line)
    }

    /// Separator and decimal sign, in words.
    pub fn conventions(&self) -> String {
        let separator = match self.separator {
            ';' => "semicolon",
            '\t' => "tab",
            ' ' => "space",
            _ => "comma",
        };
        let decimal = match self.decimal_sign.get() {
            Some(',') => "comma",
            _ => "point",
        };
        format!("fields are separated by a {separator}, decimals by a {decimal}")
    }

    /// Parses a number by the table's decimal sign, which is that of the first number with one.
    pub fn number(&self, field: &str) -> Option<f64> {
        let has_comma = self.separator != ',' && field.contains(',');
        let sign = match (has_comma, field.contains('.')) {
            (true, true) => return None,
            (true, false) => Some(','),
            (false, true) => Some('.'),
            (false, false) => None,
        };
        let plain = if has_comma {
            Cow::Owned(field.replacen(',', ".", 1))
        } else {
            Cow::Borrowed(field)
        };
        let value = plain.parse().ok()?;
        let before = self.decimal_sign.get();
        if sign.is_some() && before.is_some() && before != sign {
            return None;
        }
        self.decimal_sign.set(before.or(sign));
        Some(value)
    }
}

/// Returns the separator of a table's text.
fn separator_of(text: &str) -> char {
    let mut lines = text
        .lines()
        .filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    // A line of numbers tells more than a header, whose names may hold spaces.
    let header = lines.next().unwrap_or_default();
    let sample = lines.next().unwrap_or(header);
    let [of_header, of_sample] = [header, sample].map(|line| SEPARATORS.map(|s| fields(line, s)));
    let first = |holds: &dyn Fn(usize) -> bool| (0..SEPARATORS.len()).find(|&index| holds(index));
    // Both lines with as many fields, then both with some, then one.
    let found = first(&|index| of_header[index] > 1 && of_header[index] == of_sample[index])
        .or_else(|| first(&|index| of_header[index] > 1 && of_sample[index] > 1))
        .or_else(|| first(&|index| of_sample[index] > 1))
        .or_else(|| first(&|index| of_header[index] > 1 && SEPARATORS[index] != ' '));
    found.map_or(',', |index| SEPARATORS[index])
}

/// Number of fields of a line; separators within quotation marks do not count, nor does a last empty field. Words are
/// separated by any number of spaces.
fn fields(line: &str, separator: char) -> usize {
    if separator == ' ' {
        return line.split_whitespace().count();
    }
    let mut quoted = false;
    let separators = line.trim_end().trim_end_matches(separator).chars();
    let outside = separators.filter(|&character| {
        quoted ^= character == '"';
        !quoted && character == separator
    });
    1 + outside.count()
}

/// Text with one space between the words of a line.
fn single_spaces(text: &str) -> String {
    let lines = text
        .lines()
        .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    lines.collect::<Vec<_>>().join("\n")
}

/// A field as an error shows it.
fn shown(field: &str) -> Cow<'_, str> {
    match field.char_indices().nth(SHOWN_CHARACTERS) {
        Some((end, _)) => Cow::Owned(format!("{}…", &field[..end])),
        None => Cow::Borrowed(field),
    }
}

/// Names of a table's columns.
#[derive(Clone, Debug)]
pub struct Header<'a> {
    table: &'a CsvTable,
    names: StringRecord,
    /// Line of the names, from 1.
    pub line: u64,
}

impl Header<'_> {
    /// The names, in the order of the columns.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter()
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.names.len()
    }

    /// Returns the index of the column `name`, if there is one.
    ///
    /// # Errors
    /// Two columns of this name.
    pub fn column(&self, name: &str) -> Result<Option<usize>> {
        let mut found = (0..self.names.len()).filter(|&index| &self.names[index] == name);
        match (found.next(), found.next()) {
            (index, None) => Ok(index),
            (_, Some(_)) => Err(self.error(format!("more than one column '{name}'"))),
        }
    }

    /// Returns the index of the column `name`; `expected` tells in words which columns such a table has.
    ///
    /// # Errors
    /// No column of this name, or two; a first line of numbers, which is no header.
    pub fn needed(&self, name: &str, expected: &str) -> Result<usize> {
        if let Some(index) = self.column(name)? {
            return Ok(index);
        }
        let names: Vec<&str> = self.names.iter().collect();
        let names = names.join(",");
        let is_number = |field: &str| self.table.number(field).is_some();
        let problem = if names.is_empty() {
            format!("no column '{name}', because there is no line with names: {expected}")
        } else if self.names.iter().all(is_number) {
            format!(
                "no column '{name}' in the header '{}': the first line is numbers, so add a line with the names above \
                 it; {expected}",
                shown(&names)
            )
        } else {
            format!(
                "no column '{name}' in the header '{}' ({}): {expected}",
                shown(&names),
                self.table.conventions()
            )
        };
        Err(self.error(problem))
    }

    /// An error at the header's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        Error::line(&self.table.path, self.line, problem)
    }
}

/// Rows of a table, one after the other.
pub struct Rows<'a> {
    table: &'a CsvTable,
    reader: csv::Reader<&'a [u8]>,
    record: StringRecord,
    /// Fields of the first row, which every row has.
    width: Option<usize>,
}

impl<'a> Rows<'a> {
    /// Returns the next row; `None` at the end.
    ///
    /// # Errors
    /// A row with another number of fields than the first.
    pub fn next_row(&mut self) -> Result<Option<Row<'_, 'a>>> {
        let table = self.table;
        let line = loop {
            let begin = self.reader.position().clone();
            let line = line_of_record(&table.text, &begin);
            match self.reader.read_record(&mut self.record) {
                Ok(true) => {}
                Ok(false) => return Ok(None),
                Err(failure) => return Err(Error::line(&table.path, line, failure.to_string())),
            }
            // A line of spaces is an empty one.
            if self.record.len() != 1 || !self.record[0].is_empty() {
                break line;
            }
        };
        let count = self.record.len();
        let ends_empty = count > 1 && self.record[count - 1].is_empty();
        let width = match self.width {
            None if ends_empty => count - 1,
            None => count,
            Some(width) => width,
        };
        self.width = Some(width);
        // A separator at the end of the line, as spreadsheets write it.
        if count == width + 1 && ends_empty {
            self.record.truncate(width);
        } else if count != width {
            return Err(self.unequal(line, width));
        }
        Ok(Some(Row {
            table,
            line,
            fields: &self.record,
        }))
    }

    /// The error of a row with another number of fields than the first.
    fn unequal(&self, line: u64, width: usize) -> Error {
        let (table, count) = (self.table, self.record.len());
        let remedy = match self.record.get(width) {
            Some(first) => {
                let commas = if table.separator == ',' {
                    ", and decimal commas need another separator"
                } else {
                    ""
                };
                format!(
                    "'{}' in column {} is of no column{commas}",
                    shown(first),
                    width + 1
                )
            }
            None => format!("column {} is missing", count + 1),
        };
        let problem = format!(
            "{count} fields where the first line has {width} ({}): {remedy}",
            table.conventions()
        );
        Error::line(&table.path, line, problem)
    }
}

/// Fields of a row.
#[derive(Clone, Copy, Debug)]
pub struct Row<'r, 'a> {
    table: &'a CsvTable,
    /// Its line in the file, from 1.
    pub line: u64,
    fields: &'r StringRecord,
}

impl<'r> Row<'r, '_> {
    /// Number of fields.
    pub fn width(&self) -> usize {
        self.fields.len()
    }

    /// The fields.
    pub fn fields(&self) -> impl Iterator<Item = &'r str> {
        self.fields.iter()
    }

    /// The text of a field; empty where there is none.
    pub fn text(&self, index: usize) -> &'r str {
        self.fields.get(index).unwrap_or_default()
    }

    /// Parses a field as a number, which may be infinite or not a number where it says so.
    ///
    /// # Errors
    /// A field that is none, with its line and column.
    pub fn number(&self, index: usize) -> Result<f64> {
        let field = self.text(index);
        self.table.number(field).ok_or_else(|| {
            self.error(format!(
                "'{}' in column {} is not a number ({})",
                shown(field),
                index + 1,
                self.table.conventions()
            ))
        })
    }

    /// Parses a field of the column `name` as a finite number.
    ///
    /// # Errors
    /// A field that is none, with its line and column.
    pub fn finite(&self, index: usize, name: &str) -> Result<f64> {
        let field = self.text(index);
        let value = self.table.number(field).filter(|value| value.is_finite());
        value.ok_or_else(|| {
            self.error(format!(
                "{name} is '{}', which is not a finite number (column {}; {})",
                shown(field),
                index + 1,
                self.table.conventions()
            ))
        })
    }

    /// An error at the row's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        Error::line(&self.table.path, self.line, problem)
    }
}

/// Returns the line, from 1, of the record that a reader finds at `position`. The reader's own line is that of the end
/// of the record before, because it skips comments and empty lines.
fn line_of_record(text: &str, position: &csv::Position) -> u64 {
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let skipped = rest
        .split('\n')
        .take_while(|line| line.trim_end_matches('\r').is_empty() || line.starts_with('#'));
    position.line() + skipped.count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::holds;
    use proptest::prelude::*;

    fn table(text: &str) -> CsvTable {
        CsvTable::of(Path::new("a.csv"), text.to_owned())
    }

    /// All rows as numbers.
    fn numbers(table: &CsvTable) -> Result<Vec<Vec<f64>>> {
        let (mut rows, mut all) = (table.rows_below_header()?, Vec::new());
        while let Some(row) = rows.next_row()? {
            let fields = (0..row.width()).map(|index| row.finite(index, "x"));
            all.push(fields.collect::<Result<Vec<f64>>>()?);
        }
        Ok(all)
    }

    #[test]
    fn separators_are_found() {
        for (text, expected) in [
            ("a,b\n1.5,2\n", ','),
            ("a;b\n1,5;2\n", ';'),
            ("a;b\n1.5;2\n", ';'),
            ("# made, by hand\na\tb\n1,5\t2\n", '\t'),
            ("\u{feff}a;b\n1,5e-3;2\n", ';'),
            ("   5.79e-02\n   5.8e-02\n", ','),
            ("0.1 0.2\n0.3 0.4\n", ' '),
            ("time_s speed force\n0,5 100,0 1,0\n", ' '),
            ("file,texture\n\"a;b.wav\",silk\n", ','),
            ("file,texture\na;b.wav,silk\n", ','),
            ("file;texture;\na,b.wav;silk;\n", ';'),
            ("1\n2\n", ','),
            ("", ','),
        ] {
            assert_eq!(table(text).separator, expected, "{text:?}");
        }
    }

    #[test]
    fn tables_of_every_dialect_are_the_same_table() {
        let expected = vec![vec![0.0, 1.25], vec![0.5, -2.0]];
        for text in [
            "t,x\n0,1.25\n0.5,-2\n",
            "t;x\n0;1,25\n0,5;-2\n",
            "\u{feff}t\tx\r\n0\t1,25\r\n0,5\t-2\r\n",
            "t x\n0   1.25\n0.5 -2\n",
            "# notes; of a hand\n\nt;x;\n0;1.25;\n   \n0.5;-2;\n",
            "t,x\n\"0\",\"1.25\"\n\"0.5\",\"-2\"\n",
        ] {
            assert_eq!(numbers(&table(text)).unwrap(), expected, "{text:?}");
        }
    }

    #[test]
    fn a_table_has_one_decimal_sign() {
        let semicolons = table("x;y\n1,5;2\n");
        assert_eq!(semicolons.number("-1,25e-3"), Some(-1.25e-3));
        assert_eq!(semicolons.number("1.250,5"), None);
        assert_eq!(semicolons.number("1.5"), None, "after a decimal comma");
        let message = numbers(&table("x;y\n1.5;2\n1,250;2\n"))
            .unwrap_err()
            .to_string();
        holds(
            &message,
            &[
                "line 3",
                "column 1",
                "'1,250'",
                "semicolon",
                "decimals by a point",
            ],
        );
    }

    /// Separators with decimal signs.
    const DIALECTS: [(&str, &str); 5] =
        [(";", ","), (";", "."), ("\t", ","), (",", "."), (" ", ".")];

    proptest! {
        /// Lines are those of the text, whatever comments, empty lines and line ends are above.
        #[test]
        fn a_row_knows_its_line(above in prop::collection::vec("(# ?[a-z;,]{0,5}|)", 0..6), crlf: bool) {
            let end = if crlf { "\r\n" } else { "\n" };
            let mut text = format!("x;y{end}");
            above.iter().for_each(|line| text.push_str(&format!("{line}{end}")));
            text.push_str(&format!("1;2{end}"));
            let table = table(&text);
            let mut rows = table.rows_below_header().unwrap();
            let line = rows.next_row().unwrap().unwrap().line;
            prop_assert_eq!(line, above.len() as u64 + 2);
            prop_assert_eq!(table.line_of_row(1), line);
        }

        /// Numbers come back from a table that was written with any separator and decimal sign.
        #[test]
        fn numbers_survive_every_dialect(
            rows in prop::collection::vec((-1e9..1e9f64, -1e9..1e9f64), 1..10),
            (separator, sign) in prop::sample::select(DIALECTS.to_vec()),
        ) {
            let written = |x: f64| format!("{x:?}").replace('.', sign);
            let mut text = format!("x{separator}y\n");
            for (x, y) in &rows {
                text.push_str(&format!("{}{separator}{}\n", written(*x), written(*y)));
            }
            let expected: Vec<Vec<f64>> = rows.iter().map(|&(x, y)| vec![x, y]).collect();
            prop_assert_eq!(numbers(&table(&text)).unwrap(), expected);
        }
    }
}
