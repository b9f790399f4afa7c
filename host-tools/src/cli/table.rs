//! Plain text tables. One rule decides how a table is made narrow enough for a line. First it wraps the headings. Then
//! it drops columns that have a single value, and states that value below. Then it wraps the cells. Finally it drops
//! its last columns, and names them below. No table is divided into several.

use stylus_evaluation::table::Table;
use stylus_support::visible::visible_line;

use super::output::is_full;
use super::output::{LINE_CHARS, folded_text, wrapped};

/// Characters between two columns.
const GAP: usize = 2;

/// Longest word that is never broken, characters. It is long enough for most textures' names.
const WORD_CHARS: usize = 24;

/// Texts of cells that count as empty.
const NOTHING: [&str; 5] = ["", "0", "-", "–", "none"];

/// Formats `rows` under `header`. A cell that begins like a number is aligned to the right, any other text to the left.
/// Lines have at most [`LINE_CHARS`] characters, unless `--full` requires every column. Cells that a row lacks at its
/// end are empty. Without a header the text is empty.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    fitted(header, rows, is_full())
}

/// Formats like [`table`], with every column if `is_full`.
fn fitted(header: &[&str], rows: &[Vec<String>], is_full: bool) -> String {
    let mut columns: Vec<Column> = (header.iter().enumerate())
        .map(|(index, heading)| Column::new(heading, rows.iter().map(|row| row.get(index))))
        .collect();
    if columns.is_empty() {
        return String::new();
    }
    let (mut same, mut left_out) = (Vec::new(), Vec::new());
    if width(&columns) > LINE_CHARS {
        columns.iter_mut().for_each(Column::wrap_heading);
    }
    while width(&columns) > LINE_CHARS && !is_full {
        // The first column names the rows, so it stays even if it has one value.
        let Some(idle) = columns.iter().skip(1).rposition(Column::has_one_value) else {
            break;
        };
        let Column { heading, cells, .. } = columns.remove(1 + idle);
        let value = cells
            .into_iter()
            // A zero is a value worth telling; the other signs of nothing are told as none.
            .find(|cell| !["", "-", "–"].contains(&cell.as_str()));
        same.push(format!("{heading} {}", value.as_deref().unwrap_or("none")));
    }
    narrow(&mut columns);
    while width(&columns) > LINE_CHARS && columns.len() > 2 && !is_full {
        left_out.extend(columns.pop().map(|column| column.heading));
        // The columns were narrowed for one more column, so they begin at their full widths again.
        columns.iter_mut().for_each(Column::widen);
        narrow(&mut columns);
    }
    let note = |before: &str, mut names: Vec<String>| {
        // Columns are dropped from the right.
        names.reverse();
        let line = folded_text(&format!("{before}: {}", names.join(", ")));
        (!names.is_empty()).then(|| format!("\n{line}"))
    };
    let notes = [note("in every row", same), note("left out, shown by --full", left_out)];
    let rule = "-".repeat(width(&columns));
    let headings: Vec<_> = columns.iter().map(Column::heading_lines).collect();
    let mut lines = lines_of(&headings, &columns, true);
    lines.push(rule);
    for row in 0..rows.len() {
        let cells: Vec<_> = columns.iter().map(|column| column.lines(row)).collect();
        lines.extend(lines_of(&cells, &columns, false));
    }
    lines.join("\n") + &notes.into_iter().flatten().collect::<String>()
}

/// A column in its layout.
struct Column {
    heading: String,
    cells: Vec<String>,
    /// Width of the column, characters.
    width: usize,
}

impl Column {
    fn new<'a>(heading: &str, cells: impl Iterator<Item = Option<&'a String>>) -> Self {
        let shown = |cell: &String| visible_line(cell).into_owned();
        let mut column = Self {
            heading: heading.to_owned(),
            cells: cells.map(|cell| cell.map_or_else(String::new, shown)).collect(),
            width: 0,
        };
        column.widen();
        column
    }

    /// Returns all texts of the column, the heading first.
    fn texts(&self) -> impl Iterator<Item = &str> {
        let cells = self.cells.iter().map(String::as_str);
        std::iter::once(self.heading.as_str()).chain(cells)
    }

    /// Makes the column so wide that none of its texts is wrapped.
    fn widen(&mut self) {
        let widths = self.texts().map(|text| text.chars().count());
        self.width = widths.max().unwrap_or(0);
    }

    /// Makes the column as wide as its widest cell or its heading's longest word.
    fn wrap_heading(&mut self) {
        let cells = self.cells.iter().map(|cell| cell.chars().count());
        let words = self.heading.split(' ').map(|word| word.chars().count());
        self.width = cells.chain(words).max().unwrap_or(0);
    }

    /// Returns the smallest width of the column, characters: that of its longest word, but at most [`WORD_CHARS`].
    fn least(&self) -> usize {
        self.texts()
            .flat_map(|text| text.split(' '))
            .map(|word| word.chars().count())
            .max()
            .unwrap_or(0)
            .min(WORD_CHARS)
    }

    /// Returns true if all cells count as empty, or if there are several rows and all have the same value.
    fn has_one_value(&self) -> bool {
        let is_nothing = |cell: &String| NOTHING.contains(&cell.as_str());
        let is_same = self.cells.windows(2).all(|pair| pair[0] == pair[1]);
        self.cells.iter().all(is_nothing) || (is_same && self.cells.len() > 1)
    }

    fn heading_lines(&self) -> Vec<String> {
        broken(&self.heading, self.width)
    }

    fn lines(&self, row: usize) -> Vec<String> {
        let cell = &self.cells[row];
        // By the first character, because cells such as `36.0 ± 9.0` are numbers, too.
        let is_number = cell.starts_with(|c: char| c.is_ascii_digit() || "+-".contains(c));
        let mut lines = broken(cell, self.width);
        if is_number {
            for line in &mut lines {
                *line = " ".repeat(self.width - line.chars().count()) + line;
            }
        }
        lines
    }
}

/// Returns the width of a line of `columns`, characters.
fn width(columns: &[Column]) -> usize {
    let widths: usize = columns.iter().map(|column| column.width).sum();
    widths + GAP * columns.len().saturating_sub(1)
}

/// Narrows the widest columns, as far as their words allow, until all columns fit a line.
fn narrow(columns: &mut [Column]) {
    let mut least: Vec<usize> = columns.iter().map(Column::least).collect();
    while width(columns) > LINE_CHARS {
        let Some((widest, _)) = columns
            .iter_mut()
            .zip(&mut least)
            .filter(|(column, least)| column.width > **least)
            .max_by_key(|(column, _)| column.width)
        else {
            break;
        };
        // One character at a time, so that wide columns end about equally wide.
        widest.width -= 1;
    }
    // After wrapping at words, a column may need less width.
    for column in columns {
        let lines = column.texts().flat_map(|text| broken(text, column.width));
        column.width = lines.map(|line| line.chars().count()).max().unwrap_or(0);
    }
}

/// Breaks `text` into lines of at most `width` characters: at spaces, and within words that are longer.
fn broken(text: &str, width: usize) -> Vec<String> {
    let wrapped = wrapped(text, width, "");
    let lines = wrapped.lines().flat_map(|line| {
        let letters: Vec<char> = line.chars().collect();
        // A column of empty texts has width 0, and chunks of 0 panic.
        letters
            .chunks(width.max(1))
            .map(String::from_iter)
            .collect::<Vec<String>>()
    });
    lines.collect()
}

/// Returns the lines of a row, given the lines of its cells. The texts of a header are aligned at the bottom.
fn lines_of(cells: &[Vec<String>], columns: &[Column], is_header: bool) -> Vec<String> {
    let height = cells.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let line = |index: usize| {
        let mut text = String::new();
        for (lines, column) in cells.iter().zip(columns) {
            let above = if is_header { height - lines.len() } else { 0 };
            let piece = index
                .checked_sub(above)
                .and_then(|index| lines.get(index))
                .map_or("", String::as_str);
            let padding = column.width + GAP - piece.chars().count();
            text.push_str(piece);
            text.push_str(&" ".repeat(padding));
        }
        text.trim_end().to_owned()
    };
    (0..height).map(line).collect()
}

/// Converts rows of pairs, heading and cell, to a header and rows for [`table`]; both are empty without rows.
pub fn headed<const N: usize>(
    rows: impl IntoIterator<Item = [(&'static str, String); N]>,
) -> (Vec<&'static str>, Vec<Vec<String>>) {
    let mut header = Vec::new();
    let rows = rows
        .into_iter()
        .map(|row| {
            header = row.iter().map(|(heading, _)| *heading).collect();
            row.into_iter().map(|(_, cell)| cell).collect()
        })
        .collect();
    (header, rows)
}

/// Formats a table of results under its title.
pub fn shown(results: &Table) -> String {
    let headings: Vec<&str> = results.headings.iter().map(String::as_str).collect();
    format!("{}\n{}", results.title, table(&headings, &results.rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn widest(text: &str) -> usize {
        text.lines().map(|line| line.chars().count()).max().unwrap()
    }

    fn row(cells: &[&str]) -> Vec<String> {
        cells.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_wide_table_stays_one_and_says_the_columns_of_one_value_below_before_it_wraps() {
        let remark = "words of a remark ".repeat(6);
        let header = ["texture", "from", "an idle column of many words", "doubtful", "remark"];
        let rows = [
            row(&["paper", "simulated", "-", "12", remark.trim()]),
            row(&["organza", "simulated", "", "0", "short"]),
        ];
        let text = table(&header, &rows);
        assert!(widest(&text) <= LINE_CHARS, "{text}");
        assert_eq!(text.lines().filter(|line| line.starts_with("---")).count(), 1);
        let (table, note) = text.rsplit_once('\n').unwrap();
        let same = "in every row: from simulated, an idle column of many words none";
        assert_eq!(note, same);
        assert!(!table.contains("from"), "{table}");
        assert!(table.contains("doubtful"), "{table}");
        assert_eq!(table.split_whitespace().filter(|word| *word == "remark").count(), 7);
        // A single row has no columns to drop, and a table that is narrow enough keeps every column.
        assert!(super::table(&header, &rows[..1]).contains("from"));
        let narrow = super::table(&header[..2], &[rows[0][..2].to_vec(), rows[1][..2].to_vec()]);
        assert!(narrow.contains("from"), "{narrow}");
        assert!(!narrow.contains("every"), "{narrow}");
    }

    #[test]
    fn columns_for_which_no_line_has_room_are_named_and_full_has_them_all() {
        let header: Vec<String> = (0..30).map(|column| format!("column{column}")).collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let cells = |row: usize| (0..30).map(|column| format!("{row}.{column}")).collect();
        let rows: Vec<Vec<String>> = (1..4).map(cells).collect();
        let text = fitted(&header, &rows, false);
        assert!(widest(&text) <= LINE_CHARS, "{text}");
        let (table, left_out) = text.split_once("\nleft out, shown by --full: ").unwrap();
        assert!(table.starts_with("column0  column1  ") && left_out.ends_with("column29"));
        let full = fitted(&header, &rows, true);
        for heading in header {
            let count = |text: &str| text.matches(&format!("{heading} ")).count();
            assert!(text.contains(heading), "{heading}");
            assert_eq!(count(&format!("{} ", full.lines().next().unwrap())), 1);
        }
    }

    #[test]
    fn a_word_that_is_longer_than_a_line_is_broken() {
        let path = "folder/".repeat(30);
        let text = table(&["texture", "library"], &[row(&["paper", &path])]);
        assert!(widest(&text) <= LINE_CHARS, "{text}");
        let whole: String = text.lines().skip(2).flat_map(str::split_whitespace).collect();
        assert_eq!(whole, format!("paper{path}"));
    }

    #[test]
    fn columns_are_aligned_by_their_kind() {
        let rows = vec![row(&["paper", "9.5"]), row(&["organza", "12.25"])];
        let expected = "texture  C\n--------------\npaper      9.5\norganza  12.25";
        assert_eq!(table(&["texture", "C"], &rows), expected);
    }
}
