//! Tables as CSV: one dialect for every table that a command reads.
//!
//! A table comes from a program that its user did not write. Its separator is a semicolon, a tab, a comma or a space.
//! Its decimal sign is a point, or a comma if the comma is not the separator. The table may begin with a byte order
//! mark, and each line may end with a separator, as spreadsheets write it. Lines that begin with `#` or `%` are
//! comments, and so is a logger's preamble. An exception is a comment with names directly above the first row of
//! numbers, as NumPy's `savetxt` writes it: it is the header. Empty lines are ignored, and so are spaces around a
//! field. An error about a field states the line, the column and the separator.
//!
//! A file is read row by row, so that memory does not grow with its size, unless it is in UTF-16.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use csv_core::ReadRecordResult;

use super::bounded_file::Format;
use super::files;
use crate::{Error, Result};

mod first_lines;

use first_lines::{FirstLines, MOST_BYTES, MOST_LINES, split};

/// Characters of units, ², µ, ° and ·, in the Western European code page.
const SIGNS: [u8; 4] = [0xb2, 0xb5, 0xb0, 0xb7];

/// Largest size of a row, bytes.
const MOST_ROW_BYTES: usize = 1 << 20;

/// Largest number of fields of a row: as many as a spreadsheet has columns.
const MOST_FIELDS: usize = 16_384;

/// Largest number of characters of a field that an error repeats.
const SHOWN_CHARACTERS: usize = 40;

/// Number of first lines that an excerpt has, and largest number of characters of each, because patterns are sought in
/// an excerpt.
const SHOWN_LINES: u64 = 8;
const SHOWN_OF_LINE: usize = 1000;

/// A table, with its separator and its decimal sign.
#[derive(Debug)]
pub struct CsvTable {
    path: PathBuf,
    text: Text,
    first_lines: FirstLines,
    /// Decimal sign of the numbers read so far; `None` until a number has one.
    decimal_sign: Cell<Option<char>>,
}

/// The text of a table.
#[derive(Debug)]
enum Text {
    File(Format),
    Memory(String),
}

impl CsvTable {
    /// Opens the file at `path`, which has this `format`. A pipe is held in memory, because it can be read
    /// only once.
    ///
    /// # Errors
    /// The file cannot be read or is larger than the limit, or one of its first lines is too long or not UTF-8.
    pub fn read(path: &Path, format: Format) -> Result<Self> {
        let is_file = files::is_file(path);
        let text = if !is_file {
            Text::Memory(format.read_text(path)?)
        } else if let Some(text) = utf_16(path, format)? {
            Text::Memory(text)
        } else {
            Text::File(format)
        };
        Self::with(path, text)
    }

    /// Creates the table in `text`; `path` is used only in errors.
    ///
    /// # Errors
    /// One of the first lines is longer than a row may be.
    pub fn of(path: &Path, text: String) -> Result<Self> {
        Self::with(path, Text::Memory(text))
    }

    /// Evaluates the first lines of `text`.
    fn with(path: &Path, text: Text) -> Result<Self> {
        let mut table = Self {
            path: path.to_owned(),
            text,
            first_lines: FirstLines::default(),
            decimal_sign: Cell::new(None),
        };
        let (mut first, mut rows, mut bytes) = (Vec::new(), 0, 0);
        let mut lines = table.lines()?;
        // Two rows show the separator, however long they are.
        while (rows < 2 || rows < MOST_LINES && bytes < MOST_BYTES) && lines.advance()? {
            let is_row = lines.is_content();
            if rows == 0 && !is_row {
                // Of the comments, only the last one above the first row may name the columns.
                first.clear();
            }
            if rows == 0 || is_row {
                first.push((lines.number, lines.line.clone()));
            }
            rows += usize::from(is_row);
            bytes += lines.line.len();
        }
        drop(lines);
        table.first_lines = FirstLines::of(&first);
        Ok(table)
    }

    fn lines(&self) -> Result<Lines<'_>> {
        // Each pass reads the file anew, so that nothing of it is kept.
        let reader: Box<dyn BufRead> = match &self.text {
            Text::File(format) => Box::new(BufReader::new(format.open(&self.path)?)),
            Text::Memory(text) => Box::new(text.as_bytes()),
        };
        Ok(Lines {
            path: &self.path,
            reader,
            first: &self.first_lines,
            bytes: Vec::new(),
            line: String::new(),
            number: 0,
        })
    }

    /// Returns the file, as errors name it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the first line that is not a comment, as the names of the columns. A table without such a line has no
    /// names.
    pub fn header(&self) -> Result<Header<'_>> {
        let mut rows = self.rows()?;
        let (names, line) = match rows.next_row()? {
            Some(row) => (row.fields.clone(), row.line),
            None => (Fields::default(), 1),
        };
        Ok(Header {
            table: self,
            names,
            line,
        })
    }

    /// Returns the comments above the first line that is not a comment, up to the one with which they have 64 KiB.
    pub fn comments(&self) -> Result<String> {
        let (mut lines, mut comments) = (self.lines()?, String::new());
        while comments.len() < MOST_BYTES && lines.advance()? && !lines.is_content() {
            comments.push_str(&lines.line);
        }
        Ok(comments)
    }

    /// Returns the beginnings of the line of this number and of the first lines, as they are but for spaces that
    /// separate fields.
    pub fn excerpt(&self, line: u64) -> Result<String> {
        let (mut lines, mut own, mut first) = (self.lines()?, String::from("\n"), String::new());
        while lines.number < line.max(SHOWN_LINES) && lines.advance()? {
            let begin = || {
                lines
                    .line
                    .trim_end_matches('\n')
                    .chars()
                    .take(SHOWN_OF_LINE)
                    .chain(['\n'])
            };
            if lines.number == line {
                own = begin().collect();
            }
            if lines.number <= SHOWN_LINES {
                first.extend(begin());
            }
        }
        Ok(own + &first)
    }

    /// Returns all lines with fields, including the header.
    pub fn rows(&self) -> Result<Rows<'_>> {
        let mut parser = csv_core::ReaderBuilder::new();
        parser.delimiter(self.first_lines.separator as u8);
        Ok(Rows {
            table: self,
            lines: self.lines()?,
            labels: self.first_lines.labels.as_deref(),
            parser: parser.build(),
            fields: Fields::default(),
            width: None,
            may_be_cut_off: false,
            is_cut_off: false,
        })
    }

    /// Returns the lines below the header.
    pub fn rows_below_header(&self) -> Result<Rows<'_>> {
        let mut rows = self.rows()?;
        rows.next_row()?;
        Ok(rows)
    }

    /// Returns the line, from 1, of the row with this index; 0 if there is no such row. Row 0 is the first line that is
    /// not a comment. After it, rows without a number, such as units, do not count.
    pub fn line_of_row(&self, index: usize) -> u64 {
        // The table is read again, because only an error needs the line of a row.
        let line = |mut rows: Rows<'_>| {
            let mut before = 0;
            loop {
                let row = rows.next_row().ok()??;
                let counts = before == 0 || row.fields().any(|field| self.number(field).is_some());
                if counts && before == index {
                    return Some(row.line);
                }
                before += usize::from(counts);
            }
        };
        self.rows().ok().and_then(line).unwrap_or(0)
    }

    /// Returns how to write a number in place of `field`: the table's conventions, or seconds if the field is a date.
    fn remedy(&self, field: &str) -> String {
        if is_date(field) {
            return "a date; write seconds, in pandas by t = pandas.to_datetime(t); t = (t - t[0]).dt.total_seconds()"
                .to_owned();
        }
        self.conventions()
    }

    /// Returns the separator and the decimal sign, in words.
    pub fn conventions(&self) -> String {
        let separator = match self.first_lines.separator {
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

    /// Parses a number with the decimal sign of the table, which is the sign of the first number that has one.
    pub fn number(&self, field: &str) -> Option<f64> {
        let has_comma = self.first_lines.separator != ',' && field.contains(',');
        let sign = match (has_comma, field.contains('.')) {
            (true, true) => return None,
            (true, false) => Some(','),
            (false, true) => Some('.'),
            (false, false) => None,
        };
        let plain = if has_comma {
            // Only the first: with a second comma, the text must be no number.
            Cow::Owned(field.replacen(',', ".", 1))
        } else {
            Cow::Borrowed(field)
        };
        // Only a number decides the decimal sign, not a name with a point in it.
        let value = plain.parse().ok()?;
        let before = self.decimal_sign.get();
        if sign.is_some() && before.is_some() && before != sign {
            return None;
        }
        self.decimal_sign.set(before.or(sign));
        Some(value)
    }
}

/// Characters with which a comment begins: `#` in Python and shells, `%` in MATLAB.
const COMMENT_SIGNS: [char; 2] = ['#', '%'];

/// Returns the text of a comment, which begins with one or more such characters; `None` if `line` is not a comment.
pub fn comment(line: &str) -> Option<&str> {
    line.starts_with(COMMENT_SIGNS)
        .then(|| line.trim_start_matches(COMMENT_SIGNS))
}

/// Sign before a text that a spreadsheet would otherwise compute.
const GUARD: char = '\'';

/// Returns true if `text` begins like a formula, after any number of guards. It is written with one guard more, which
/// is left out when it is read.
fn is_formula(text: &str) -> bool {
    text.trim_start_matches(GUARD).starts_with(['=', '+', '-', '@'])
}

/// Returns `rows` as CSV. [`Row::text`] returns each field as it was, and a spreadsheet computes none of them.
pub fn written<'f>(rows: impl IntoIterator<Item = impl IntoIterator<Item = &'f str>>) -> String {
    let mut text = String::new();
    for row in rows {
        for (index, field) in row.into_iter().enumerate() {
            text.extend((index > 0).then_some(','));
            let is_number = field.parse().is_ok_and(f64::is_finite);
            let is_quoted = field.contains([',', '"', '\n', '\r']) || comment(field).is_some();
            text.extend(is_quoted.then_some('"'));
            text.extend((is_formula(field) && !is_number).then_some(GUARD));
            text.push_str(&if is_quoted {
                field.replace('"', "\"\"")
            } else {
                field.to_owned()
            });
            text.extend(is_quoted.then_some('"'));
        }
        text.push('\n');
    }
    text
}

/// Returns whether `line` is neither empty nor a comment.
pub fn is_content(line: &str) -> bool {
    comment(line).is_none() && !line.trim().is_empty()
}

/// Checks the length of a row, bytes, before anything else is done with it.
///
/// # Errors
/// The row is too long; the error states its `line`.
pub fn check_length(path: &Path, line: u64, bytes: usize) -> Result<()> {
    let problem = || format!("a row of more than {MOST_ROW_BYTES} bytes: is it a table?");
    (bytes <= MOST_ROW_BYTES)
        .then_some(())
        .ok_or_else(|| Error::line(path, line, problem()))
}

/// Returns the text of the file at `path` if its byte order mark indicates UTF-16, which the Windows shell writes.
fn utf_16(path: &Path, format: Format) -> Result<Option<String>> {
    let mut mark = [0; 2];
    let read = format.open(path)?.read(&mut mark);
    let unit = match (read.map_err(Error::io("read", path))?, mark) {
        (2, [0xff, 0xfe]) => u16::from_le_bytes,
        (2, [0xfe, 0xff]) => u16::from_be_bytes,
        _ => return Ok(None),
    };
    // Lines are sought as bytes, so this text is converted as a whole.
    let bytes = format.read(path)?;
    let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    let characters = char::decode_utf16(units).map(|found| found.unwrap_or(char::REPLACEMENT_CHARACTER));
    Ok(Some(characters.collect()))
}

/// The lines of a text, read one after the other.
struct Lines<'a> {
    path: &'a Path,
    reader: Box<dyn BufRead + 'a>,
    first: &'a FirstLines,
    bytes: Vec<u8>,
    /// The line, ended by a line feed. If the separator is a space, there is exactly one between two words.
    line: String,
    /// Number of the line, from 1.
    number: u64,
}

impl Lines<'_> {
    /// Reads the next line; returns false at the end.
    fn advance(&mut self) -> Result<bool> {
        self.bytes.clear();
        // A byte more than a row may have shows that it is too long, before a file without line feeds fills the memory.
        let most = MOST_ROW_BYTES as u64 + 1;
        let read = (&mut self.reader).take(most).read_until(b'\n', &mut self.bytes);
        if read.map_err(Error::io("read", self.path))? == 0 {
            return Ok(false);
        }
        self.number += 1;
        check_length(self.path, self.number, self.bytes.len())?;
        let text = match std::str::from_utf8(&self.bytes) {
            Ok(text) => Cow::Borrowed(text),
            Err(_) if self.bytes.iter().all(|byte| byte.is_ascii() || SIGNS.contains(byte)) => {
                // Bytes of this code page have the numbers of their characters in Unicode.
                self.bytes.iter().map(|&byte| char::from(byte)).collect()
            }
            Err(_) => return Err(self.error("is not UTF-8 text: save the file as UTF-8")),
        };
        let text = match text.strip_prefix('\u{feff}') {
            Some(rest) if self.number == 1 => rest,
            _ => text.as_ref(),
        };
        let text = if self.first.commented_header == Some(self.number) {
            comment(text).unwrap_or(text)
        } else {
            text
        };
        self.line.clear();
        let separator = self.first.separator;
        if self.first.labels.is_some() {
            for (index, field) in split(text, separator).enumerate() {
                self.line.extend((index > 0).then_some(separator));
                // A field without its name stays as it is, and is refused later.
                self.line
                    .push_str(field.split_once(':').map_or(field, |(_, number)| number));
            }
        } else if separator == ' ' {
            for word in text.split_whitespace() {
                let space = if self.line.is_empty() { "" } else { " " };
                self.line.extend([space, word]);
            }
        } else {
            self.line.push_str(text.trim_end_matches(['\r', '\n']));
        }
        self.line.push('\n');
        Ok(true)
    }

    /// Reads up to the next line that is neither empty nor a comment; returns false at the end.
    fn skip_to_content(&mut self) -> Result<bool> {
        while self.advance()? {
            if self.is_content() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns whether the line is neither empty, nor a comment, nor a line of the preamble.
    fn is_content(&self) -> bool {
        self.number >= self.first.begin && is_content(&self.line)
    }

    fn error(&self, problem: &str) -> Error {
        Error::line(self.path, self.number, problem)
    }
}

/// Fields of a row, without the spaces around them.
#[derive(Clone, Debug, Default)]
struct Fields {
    text: String,
    /// End of each field in the text.
    ends: Vec<usize>,
}

impl Fields {
    fn len(&self) -> usize {
        self.ends.len()
    }

    fn get(&self, index: usize) -> Option<&str> {
        let end = *self.ends.get(index)?;
        let begin = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        Some(self.text[begin..end].trim())
    }

    fn iter(&self) -> impl Iterator<Item = &str> {
        (0..self.len()).filter_map(|index| self.get(index))
    }

    fn is_empty_at(&self, index: usize) -> bool {
        self.get(index).is_none_or(str::is_empty)
    }
}

/// Returns whether `field` begins as a date or a time of day: with digits, and then `-`, `/` or `:` and a digit.
fn is_date(field: &str) -> bool {
    let rest = field.trim_start_matches(|first: char| first.is_ascii_digit());
    let mut rest_chars = rest.chars();
    rest.len() < field.len()
        && matches!(rest_chars.next(), Some('-' | '/' | ':'))
        && rest_chars.next().is_some_and(|next| next.is_ascii_digit())
}

/// Returns a field as an error shows it.
fn shown(field: &str) -> Cow<'_, str> {
    match field.char_indices().nth(SHOWN_CHARACTERS) {
        Some((end, _)) => Cow::Owned(format!("{}…", &field[..end])),
        None => Cow::Borrowed(field),
    }
}

/// Returns whether a column's name is `known`, which is in lower case with `_` between its words and unit. Capital
/// letters and other signs between them are accepted, because people write tables by hand: `Speed (mm/s)` is
/// `speed_mm_s`, and `Normal force (N)` is `force_n`.
pub fn is_named(name: &str, known: &str) -> bool {
    name.to_lowercase()
        .replace('²', "2")
        .replace('^', "")
        .split(|sign: char| !sign.is_alphanumeric())
        .filter(|word| !["", "normal", "tangential"].contains(word))
        .eq(known.split('_'))
}

/// Names of a table's columns.
#[derive(Clone, Debug)]
pub struct Header<'a> {
    table: &'a CsvTable,
    names: Fields,
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

    /// Returns the index of the column `name`, or of one with [this name in other signs](is_named), if there is one.
    pub fn column(&self, name: &str) -> Result<Option<usize>> {
        match self.exact_column(name)? {
            None => self.single(name, |column| is_named(column, name)),
            index => Ok(index),
        }
    }

    /// Returns the index of the column with exactly this name, if there is one.
    pub fn exact_column(&self, name: &str) -> Result<Option<usize>> {
        self.single(name, |column| column == name)
    }

    fn single(&self, name: &str, is_meant: impl Fn(&str) -> bool) -> Result<Option<usize>> {
        let mut found = self.names.iter().enumerate().filter(|(_, column)| is_meant(column));
        match (found.next().map(|(index, _)| index), found.next()) {
            (index, None) => Ok(index),
            (_, Some(_)) => Err(self.error(format!("more than one column '{name}'"))),
        }
    }

    /// Returns the index of the column `name`; `expected` states in words which columns such a table has.
    ///
    /// # Errors
    /// There is no column of this name, or there are two; or the first line is numbers and not a header.
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

    /// Returns an error at the header's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        Error::line(&self.table.path, self.line, problem)
    }
}

/// Rows of a table, read one after the other.
pub struct Rows<'a> {
    table: &'a CsvTable,
    lines: Lines<'a>,
    /// Names of the columns, until they are returned as the header, if the fields themselves contain them.
    labels: Option<&'a [String]>,
    parser: csv_core::Reader,
    fields: Fields,
    /// Number of fields of the first row, which every row must have.
    width: Option<usize>,
    may_be_cut_off: bool,
    is_cut_off: bool,
}

impl<'a> Rows<'a> {
    /// Returns the next row; `None` at the end.
    pub fn next_row(&mut self) -> Result<Option<Row<'_, 'a>>> {
        let line = loop {
            let line = if let Some(labels) = self.labels.take() {
                let separator = self.table.first_lines.separator.to_string();
                self.lines.line = labels.join(&separator) + "\n";
                self.table.first_lines.begin
            } else if self.lines.skip_to_content()? {
                self.lines.number
            } else {
                return Ok(None);
            };
            self.parse()?;
            // Spreadsheets write rows that consist only of separators below a table.
            if (0..self.fields.len()).any(|index| !self.fields.is_empty_at(index)) {
                break line;
            }
        };
        let count = self.fields.len();
        let width = self.width.unwrap_or_else(|| self.first_width());
        self.width = Some(width);
        // The line ends with separators, as spreadsheets write it.
        if count > width && (width..count).all(|index| self.fields.is_empty_at(index)) {
            self.fields.ends.truncate(width);
        } else if count != width {
            // Only the last line of a file can lack its line feed.
            let is_short = count < width && self.lines.bytes.last() != Some(&b'\n');
            if self.may_be_cut_off && is_short {
                self.is_cut_off = true;
                return Ok(None);
            }
            return Err(self.unequal(line, width));
        }
        Ok(Some(Row {
            table: self.table,
            line,
            fields: &self.fields,
        }))
    }

    /// Returns the number of fields of the first row without empty ones at its end: all of them after names, one after
    /// numbers, because more may be samples that are missing.
    fn first_width(&self) -> usize {
        let count = self.fields.len();
        let are_names = (self.fields.iter()).all(|field| self.table.number(field).is_none());
        let fewest = if are_names { 1 } else { count.max(2) - 1 };
        let is_used = |&width: &usize| width == fewest || !self.fields.is_empty_at(width - 1);
        (fewest..=count).rev().find(is_used).unwrap_or(count)
    }

    /// Lets the rows end before a last line that is cut off, for example because a logger lost its power.
    pub fn end_before_cut_off(&mut self) {
        self.may_be_cut_off = true;
    }

    /// Returns true if the rows have ended before a last line that is cut off.
    pub fn are_cut_off(&self) -> bool {
        self.is_cut_off
    }

    /// Parses the row that begins in the current line. If a quoted field extends over the following lines, they are
    /// included.
    fn parse(&mut self) -> Result<()> {
        // The memory of the row before is used again: a table may have millions of rows.
        let mut text = std::mem::take(&mut self.fields.text).into_bytes();
        let ends = &mut self.fields.ends;
        text.resize(self.lines.line.len(), 0);
        ends.resize(self.width.map_or(8, |width| width + 2), 0);
        let (mut input, mut written, mut ended) = (self.lines.line.as_bytes(), 0, 0);
        loop {
            let (result, read, bytes, fields) =
                self.parser.read_record(input, &mut text[written..], &mut ends[ended..]);
            input = &input[read..];
            written += bytes;
            ended += fields;
            match result {
                ReadRecordResult::InputEmpty => {
                    // A quoted field goes on in the next line. Empty input tells the parser that the text has ended.
                    input = if self.lines.advance()? {
                        self.lines.line.as_bytes()
                    } else {
                        &[]
                    };
                }
                // A quotation mark that is never closed would take in the rest of the file.
                ReadRecordResult::OutputFull => {
                    check_length(self.lines.path, self.lines.number, written)?;
                    text.resize(2 * text.len(), 0);
                }
                ReadRecordResult::OutputEndsFull if ended > MOST_FIELDS => {
                    let problem = format!("a row of more than {MOST_FIELDS} fields: is it a table?");
                    return Err(self.lines.error(&problem));
                }
                ReadRecordResult::OutputEndsFull => ends.resize((2 * ended).min(MOST_FIELDS + 1), 0),
                ReadRecordResult::Record | ReadRecordResult::End => break,
            }
        }
        text.truncate(written);
        ends.truncate(ended);
        let text = String::from_utf8(text);
        self.fields.text = text.map_err(|_| self.lines.error("is not UTF-8 text"))?;
        Ok(())
    }

    /// Returns the error that the number of fields differs from that of the first row.
    fn unequal(&self, line: u64, width: usize) -> Error {
        let (table, count) = (self.table, self.fields.len());
        let mut further = self.fields.iter().enumerate().skip(width);
        let remedy = match further.find(|(_, field)| !field.is_empty()) {
            Some((index, first)) => {
                let commas = if table.first_lines.separator == ',' {
                    ", and decimal commas need another separator"
                } else {
                    ""
                };
                format!("'{}' in column {} is of no column{commas}", shown(first), index + 1)
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
    /// Line of the row in the file, from 1.
    pub line: u64,
    fields: &'r Fields,
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

    /// Returns the text of a field, without the sign that [`written`] puts before a formula; empty if there is no such
    /// field.
    pub fn text(&self, index: usize) -> &'r str {
        let field = self.fields.get(index).unwrap_or_default();
        field
            .strip_prefix(GUARD)
            .filter(|rest| is_formula(rest))
            .unwrap_or(field)
    }

    /// Parses a field as a number. It may be infinite or NaN if the text says so.
    ///
    /// # Errors
    /// The field is not a number; the error states the line and column.
    pub fn number(&self, index: usize) -> Result<f64> {
        let field = self.text(index);
        self.table.number(field).ok_or_else(|| {
            self.error(format!(
                "'{}' in column {} is not a number ({})",
                shown(field),
                index + 1,
                self.table.remedy(field)
            ))
        })
    }

    /// Parses a field of the column `name` as a finite number.
    ///
    /// # Errors
    /// The field is not a finite number; the error states the line and column.
    pub fn finite(&self, index: usize, name: &str) -> Result<f64> {
        let field = self.text(index);
        self.table
            .number(field)
            .filter(|value| value.is_finite())
            .ok_or_else(|| {
                self.error(format!(
                    "{name} is '{}', which is not a finite number (column {}; {})",
                    shown(field),
                    index + 1,
                    self.table.remedy(field)
                ))
            })
    }

    /// Returns an error at the row's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        Error::line(&self.table.path, self.line, problem)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::{holds, new_file};

    fn table(text: &str) -> CsvTable {
        CsvTable::of(Path::new("a.csv"), text.to_owned()).unwrap()
    }

    /// Returns all rows as numbers.
    fn numbers(table: &CsvTable) -> Result<Vec<Vec<f64>>> {
        let (mut rows, mut all) = (table.rows_below_header()?, Vec::new());
        while let Some(row) = rows.next_row()? {
            let fields = (0..row.width()).map(|index| row.finite(index, "x"));
            all.push(fields.collect::<Result<Vec<f64>>>()?);
        }
        Ok(all)
    }

    #[test]
    fn texts_in_which_patterns_are_sought_do_not_grow_with_rows_and_comments() {
        let wide = "1,".repeat(100_000) + "\n";
        assert!(table(&wide.repeat(10)).excerpt(9).unwrap().len() < 10 * SHOWN_OF_LINE);
        let told = "# a = 1\n".repeat(100_000) + "x\n1\n";
        assert!(table(&told).comments().unwrap().len() < 2 * MOST_BYTES);
    }

    #[test]
    fn an_error_about_labels_in_the_rows_states_the_first_row() {
        let table = table("# made by hand\n\nx:0.1,x:0.2\nx:0.3,x:0.4\n");
        let fault = table.header().unwrap().column("x").unwrap_err();
        holds(&fault, &["line 3", "more than one column 'x'"]);
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
            assert_eq!(table(text).first_lines.separator, expected, "{text:?}");
        }
    }

    #[test]
    fn dates_have_their_own_remedy_and_other_text_has_that_of_the_table() {
        for field in ["2026-11-27T09:00:00.125Z", "27/11/2026", "09:00:00"] {
            let text = format!("t,x\n{field},1\n");
            holds(
                &numbers(&table(&text)).unwrap_err(),
                &["line 2", field, "write seconds"],
            );
        }
        for field in ["abc", "12-", "-2026-11", "1.2.3", "5:"] {
            let text = format!("t,x\n{field},1\n");
            holds(&numbers(&table(&text)).unwrap_err(), &["decimals by"]);
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
    fn names_in_a_comment_right_above_numbers_are_the_header() {
        let names = |text: &str| {
            table(text)
                .header()
                .unwrap()
                .names()
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        for text in [
            "#time,x [g]\n0,1.5\n",
            "# of a hand\n# time;x [g]\r\n0;1,5\r\n",
            "# time\tx [g]\n0\t1.5e-3\n",
        ] {
            assert_eq!(names(text), ["time", "x [g]"], "{text:?}");
            let all = numbers(&table(text)).unwrap();
            assert_eq!(all.len(), 1, "{text:?}");
        }
        assert_eq!(names("# time_s x\n0.0 -1.5\n"), ["time_s", "x"]);
        for text in [
            "# made by hand, in May\n\n0,1\n",
            "# rate, 3200\n0,1\n",
            "# unit: g\n0 1\n",
            "# rate = 3\n0 1 2\n",
            "# x\n0\n",
            "# time,x\n# of a hand\n0,1\n",
            "# time,x,y\n0,1\n",
        ] {
            assert!(names(text).iter().all(|name| name.parse::<f64>().is_ok()), "{text:?}");
        }
    }

    #[test]
    fn a_preamble_is_left_out_and_a_header_above_rows_with_empty_ends_is_none() {
        for (text, line) in [
            ("Logger 3\nRate: 1000 Hz, 16 bits\n\nt,x,y\n0,1,2\n1,2,3\n", 4),
            ("Rig A;;\nt;x;y\ns;g;g\n0,5;1;2\n1,5;2;3\n", 2),
            ("t,x,p\n0,1,5\n1,2,\n2,3,\n3,4,6\n", 1),
            ("t,x,p\n0,1,\n1,2,\n", 1),
            ("t,x\n0,1,5\n1,2,6\n", 1),
            ("Logger 3\n0,1,5\n1,2,6\n", 2),
            ("Sheet of May\nfile,texture\na.wav,silk\n", 1),
        ] {
            let table = table(text);
            assert_eq!(table.header().unwrap().line, line, "{text:?}");
        }
    }

    #[test]
    fn signs_of_units_are_read_in_an_older_code_page() {
        let (_folder, path) = new_file("a.csv");
        std::fs::write(&path, b"t,a [m/s\xb2]\n0,1\n").unwrap();
        let found = CsvTable::read(&path, Format::Table).unwrap();
        let header = found.header().unwrap();
        assert_eq!(header.names().last(), Some("a [m/s²]"));
        std::fs::write(&path, b"t,a\xe4\n0,1\n").unwrap();
        holds(&CsvTable::read(&path, Format::Table).unwrap_err(), &["not UTF-8"]);
    }

    #[test]
    fn a_table_has_one_decimal_sign() {
        let semicolons = table("x;y\n1,5;2\n");
        assert_eq!(semicolons.number("-1,25e-3"), Some(-1.25e-3));
        assert_eq!(semicolons.number("1.250,5"), None);
        assert_eq!(semicolons.number("1.5"), None, "after a decimal comma");
        let message = numbers(&table("x;y\n1.5;2\n1,250;2\n")).unwrap_err().to_string();
        holds(
            &message,
            &["line 3", "column 1", "'1,250'", "semicolon", "decimals by a point"],
        );
    }

    #[test]
    fn a_row_has_as_many_fields_as_a_spreadsheet_has_columns() {
        for (count, is_possible) in [(MOST_FIELDS, true), (MOST_FIELDS + 2, false), (20 * MOST_FIELDS, false)] {
            let row = vec!["1"; count].join(",");
            let told = numbers(&table(&format!("{row}\n{row}\n")));
            assert_eq!(told.is_ok(), is_possible, "{count}");
            if let Err(refused) = told {
                holds(&refused, &["line 1", "16384 fields"]);
            }
        }
    }

    #[test]
    fn a_row_that_has_no_end_is_refused_and_quoted_lines_are_one_field() {
        let quoted = table("a,b\n\"x\ny\",\"1,\"\"2\"\n3,4\n");
        let mut rows = quoted.rows_below_header().unwrap();
        let row = rows.next_row().unwrap().unwrap();
        assert_eq!((row.text(0), row.text(1), row.line), ("x\ny", "1,\"2", 2));
        assert_eq!(rows.next_row().unwrap().unwrap().line, 4);
        for row in ["1,", ",\"\n\""] {
            let row = row.repeat(2 * MOST_ROW_BYTES);
            let text = format!("a,b\n1,2\n{row}");
            let told = CsvTable::of(Path::new("a.csv"), text).and_then(|table| numbers(&table));
            holds(&told.unwrap_err(), &["a row of more than"]);
        }
    }

    /// Separators with decimal signs.
    const DIALECTS: [(&str, &str); 5] = [(";", ","), (";", "."), ("\t", ","), (",", "."), (" ", ".")];

    proptest! {
        /// Line numbers are those of the text, whatever comments, empty lines and line endings precede the row.
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
            let with_units = super::tests::table(&text.replacen("x;y", "x;y\ns;g", 1));
            prop_assert_eq!(with_units.line_of_row(1), line + 1);
        }

        /// Covers formulas, guards, comments, quotation marks, separators and numbers.
        #[test]
        fn texts_are_read_back_as_they_were_written_and_no_spreadsheet_computes_one(
            texts in prop::collection::vec(["[-'=+@#\"a1 ,;:\t/]{0,6}|\\PC{1,8}", "[=+@-]?[a-z1.(),\"]{1,6}"], 1..5),
        ) {
            let texts: Vec<[&str; 2]> = texts.iter().map(|pair| pair.each_ref().map(|text| text.trim())).collect();
            let header = ["file", "texture", "speed_mm_s"];
            let rows = texts.iter().map(|&[one, other]| [one, other, "-1.5"]);
            let text = written([header].into_iter().chain(rows));
            let table = table(&text);
            let mut rows = table.rows_below_header().unwrap();
            for &[one, other] in &texts {
                let row = rows.next_row().unwrap().expect("it was written");
                prop_assert_eq!([row.text(0), row.text(1), row.text(2)], [one, other, "-1.5"], "{}", text);
                for field in row.fields() {
                    prop_assert!(!field.starts_with(['=', '+', '-', '@']) || field.parse::<f64>().is_ok(), "{}", field);
                }
            }
            prop_assert!(rows.next_row().unwrap().is_none());
        }

        /// Numbers are read back correctly from a table written with any separator and decimal sign.
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
