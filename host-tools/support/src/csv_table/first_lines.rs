//! What the first lines of a table determine: its separator, where it begins, and the names of columns that are not in
//! a header row.

use super::{comment, is_content, is_date};

/// Separators, in the order of preference.
const SEPARATORS: [char; 4] = [';', '\t', ',', ' '];

/// Largest number of lines, without comments, among which the first row of numbers is sought.
pub(super) const MOST_LINES: usize = 64;

/// Bytes of first lines after which no further one is read, so that wide tables take little memory.
pub(super) const MOST_BYTES: usize = 1 << 16;

/// What the first lines of a table determine.
#[derive(Debug, Default, PartialEq)]
pub(super) struct FirstLines {
    pub separator: char,
    /// Line, from 1, of a header that is written as a comment.
    pub commented_header: Option<u64>,
    /// Number, from 1, of the first line of the table, below a preamble.
    pub begin: u64,
    /// Names of the columns, if each field begins with the name of its column, like in the output for Arduino's
    /// plotter: `x:0.1,y:0.2`.
    pub labels: Option<Vec<String>>,
}

impl FirstLines {
    /// Evaluates `lines`, each with its number, from 1. They must not contain more than [`MOST_LINES`] lines that are
    /// not comments.
    pub fn of(lines: &[(u64, String)]) -> Self {
        let is_row = |line: &&(u64, String)| is_content(&line.1);
        let rows: Vec<&(u64, String)> = lines.iter().filter(is_row).collect();
        if let Some((begin, separator)) = after_preamble(&rows) {
            return Self {
                separator,
                begin,
                ..Self::default()
            };
        }
        let text = |index: usize| rows.get(index).map_or("", |row| row.1.as_str());
        let header = text(0);
        // A row of numbers is the better evidence, because names in a header may contain spaces.
        let separator = separator_of([header, text(1.min(rows.len().saturating_sub(1)))]);
        let first = rows.first().map_or(u64::MAX, |row| row.0);
        let above = lines.iter().take_while(|line| line.0 < first).last();
        let names = above.filter(|(_, line)| are_names(line, header, separator));
        Self {
            separator,
            commented_header: names.map(|(number, _)| *number),
            begin: names.map_or(first, |(number, _)| *number),
            labels: labels(header, separator)
                .filter(|names| rows.len() < 2 || labels(text(1), separator).as_ref() == Some(names)),
        }
    }
}

/// Returns the line at which a table begins and its separator, if there are other lines above the table. Loggers write
/// their settings there, without marking them as comments.
///
/// The table begins with the first of the successive lines that have as many fields as the first two rows of numbers.
/// These rows must have more than one field.
fn after_preamble(rows: &[&(u64, String)]) -> Option<(u64, char)> {
    let numbers = rows.windows(2).enumerate().find_map(|(index, pair)| {
        let separator = separator_of([&pair[0].1, &pair[1].1]);
        let [first, second] = [0, 1].map(|row: usize| fields(&pair[row].1, separator));
        let are_numbers = pair.iter().all(|row| split(&row.1, separator).all(is_value));
        (are_numbers && first > 1 && first == second).then_some((index, first, separator))
    });
    let (index, count, separator) = numbers?;
    let of_table = rows[..index]
        .iter()
        .rev()
        .take_while(|row| fields(&row.1, separator) == count);
    let begin = index - of_table.count();
    let last_above = rows[..begin].last()?;
    if begin == index && fields(&last_above.1, separator) > 1 {
        // It may be a header that lacks a name.
        return None;
    }
    // A line with more fields is the header of a table whose rows end with empty fields.
    (rows[..begin].iter())
        .all(|row| fields(&row.1, separator) < count)
        .then(|| (rows[begin].0, separator))
}

/// Returns the separator of a table, determined from its header and the row below, or from two rows.
fn separator_of([header, sample]: [&str; 2]) -> char {
    let [of_header, of_sample] = [header, sample].map(|line| SEPARATORS.map(|s| fields(line, s)));
    let first = |holds: &dyn Fn(usize) -> bool| (0..SEPARATORS.len()).find(|&index| holds(index));
    // Preferred: both lines have the same number of fields; then both have several; then only one has.
    first(&|index| of_header[index] > 1 && of_header[index] == of_sample[index])
        .or_else(|| first(&|index| of_header[index] > 1 && of_sample[index] > 1))
        .or_else(|| first(&|index| of_sample[index] > 1))
        .or_else(|| first(&|index| of_header[index] > 1 && SEPARATORS[index] != ' '))
        .map_or(',', |index| SEPARATORS[index])
}

/// Returns the number of fields of a line. Separators within quotation marks do not count, and neither does an empty
/// last field. Between words, any number of spaces is one separator.
fn fields(line: &str, separator: char) -> usize {
    if separator == ' ' {
        return line.split_whitespace().count();
    }
    let mut quoted = false;
    let outside = line
        .trim_end()
        .trim_end_matches(separator)
        .chars()
        .filter(|&character| {
            quoted ^= character == '"';
            !quoted && character == separator
        });
    1 + outside.count()
}

/// Returns whether the comment `line` names the columns of `numbers`, the first row below it, which may contain text as
/// well as numbers. For a single column, a comment is never a name, because any text could be one.
fn are_names(line: &str, numbers: &str, separator: char) -> bool {
    let columns = fields(numbers, separator);
    let is_name = |field: &str| {
        let begins = field.trim().starts_with(char::is_alphabetic);
        begins && !field.contains([':', '=']) && !is_number(field)
    };
    let line = comment(line).unwrap_or(line);
    columns > 1
        && columns == fields(line, separator)
        && split(numbers, separator).any(is_number)
        && split(line, separator).all(is_name)
}

/// Returns the names, if every field of the line consists of a name, a colon and a number.
fn labels(line: &str, separator: char) -> Option<Vec<String>> {
    split(line, separator)
        .map(|field| {
            let (name, number) = field.trim().split_once(':')?;
            let is_label = name.starts_with(char::is_alphabetic) && is_number(number);
            is_label.then(|| name.to_owned())
        })
        .collect()
}

/// Returns true for a number, a date or a time of day, with or without quotation marks.
fn is_value(field: &str) -> bool {
    let field = field.trim().trim_matches('"');
    is_number(field) || is_date(field)
}

fn is_number(field: &str) -> bool {
    field.trim().replace(',', ".").parse::<f64>().is_ok()
}

/// Returns the fields of a line, counted like in [`fields`] but without regard to quotation marks.
pub(super) fn split(line: &str, separator: char) -> impl Iterator<Item = &str> {
    let line = line.trim().trim_end_matches(separator).split(separator);
    // Between words, any number of spaces is one separator.
    line.filter(move |field| separator != ' ' || !field.is_empty())
}
