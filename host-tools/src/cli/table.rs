//! Plain text tables.

use host_tools::evaluation::tables::Table;
use host_tools::support::visible::visible_line;

/// `rows` under `header`, columns aligned: text to the left, numbers to the right. A cell is one line, whatever a name
/// in it holds. Without a header there is nothing.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    if header.is_empty() {
        return String::new();
    }
    let shown = |row: &Vec<String>| -> Vec<String> {
        let cells = row.iter().map(|cell| visible_line(cell).into_owned());
        cells.collect()
    };
    let rows: Vec<Vec<String>> = rows.iter().map(shown).collect();
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        let widest = cells.map(|cell| cell.chars().count()).max().unwrap_or(0);
        widest.max(header[column].chars().count())
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let is_number = |cell: &str| cell.starts_with(|c: char| c.is_ascii_digit() || "+-".contains(c));
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut text = String::new();
        for (cell, &width) in cells.zip(&widths) {
            let padding = " ".repeat(width - cell.chars().count());
            let (before, after) = if is_number(cell) {
                (padding.as_str(), "")
            } else {
                ("", padding.as_str())
            };
            text.push_str(&format!("{before}{cell}{after}  "));
        }
        text.trim_end().to_owned()
    };
    let mut lines = vec![line(&mut header.iter().copied())];
    lines.push("-".repeat(widths.iter().sum::<usize>() + 2 * (widths.len() - 1)));
    lines.extend(
        rows.iter()
            .map(|row| line(&mut row.iter().map(String::as_str))),
    );
    lines.join("\n")
}

/// The header and the rows of a table, of rows whose cells stand beside their headings; nothing of no rows.
pub fn headed<const N: usize>(
    rows: impl IntoIterator<Item = [(&'static str, String); N]>,
) -> (Vec<&'static str>, Vec<Vec<String>>) {
    let mut header = Vec::new();
    let rows = rows.into_iter().map(|row| {
        header = row.iter().map(|(heading, _)| *heading).collect();
        row.into_iter().map(|(_, cell)| cell).collect()
    });
    let rows = rows.collect();
    (header, rows)
}

/// Characters of a line of a terminal that tables keep to.
pub const LINE_CHARS: usize = 80;

/// [`table`] in lines of at most [`LINE_CHARS`] characters: as several tables, one below the other, where one is too
/// wide. Each begins with the first `keys` columns, which name the row. Only a column of its own may be wider. A row
/// that ends early is empty from there on.
pub fn folded_table(header: &[&str], rows: &[Vec<String>], keys: usize) -> String {
    let width = |columns: &[usize]| {
        let text = table_of(header, rows, columns);
        text.lines()
            .map(|line| line.chars().count())
            .max()
            .unwrap_or(0)
    };
    let named: Vec<usize> = (0..keys).collect();
    let mut tables: Vec<Vec<usize>> = vec![named.clone()];
    for column in keys..header.len() {
        let last = tables.last_mut().expect("there is one");
        last.push(column);
        if width(last) > LINE_CHARS && last.len() > keys + 1 {
            last.pop();
            tables.push([named.as_slice(), &[column]].concat());
        }
    }
    let tables: Vec<String> = (tables.iter())
        .map(|columns| table_of(header, rows, columns))
        .collect();
    tables.join("\n\n")
}

fn table_of(header: &[&str], rows: &[Vec<String>], columns: &[usize]) -> String {
    let header: Vec<&str> = columns.iter().map(|&column| header[column]).collect();
    let cells = |row: &Vec<String>| {
        let cell = |&column: &usize| row.get(column).cloned().unwrap_or_default();
        columns.iter().map(cell).collect()
    };
    let rows: Vec<Vec<String>> = rows.iter().map(cells).collect();
    table(&header, &rows)
}

/// `text` in lines of at most [`LINE_CHARS`] characters, broken at spaces.
pub fn folded_text(text: &str) -> String {
    wrapped(text, LINE_CHARS, "")
}

/// `text` in lines of at most so many characters, broken at spaces; those after a break begin with `indent`.
pub fn wrapped(text: &str, width: usize, indent: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for (index, word) in paragraph.split(' ').enumerate() {
            if index > 0 && line.chars().count() + 1 + word.chars().count() > width {
                lines.push(std::mem::replace(&mut line, format!("{indent}{word}")));
                continue;
            }
            if index > 0 {
                line.push(' ');
            }
            line.push_str(word);
        }
        lines.push(line);
    }
    lines.join("\n")
}

/// A table of results under its title, in [`folded_table`]'s lines.
pub fn shown(table: &Table, keys: usize) -> String {
    let headings: Vec<&str> = table.headings.iter().map(String::as_str).collect();
    let rows = folded_table(&headings, &table.rows, keys);
    format!("{}\n{rows}", table.title)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn widest(text: &str) -> usize {
        text.lines().map(|line| line.chars().count()).max().unwrap()
    }

    #[test]
    fn a_wide_table_becomes_several_that_fit_and_each_names_its_rows() {
        let header: Vec<String> = (0..30).map(|column| format!("column {column}")).collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let row = |row: usize| (0..30).map(|column| format!("{row}.{column}")).collect();
        let rows: Vec<Vec<String>> = (0..3).map(row).collect();
        assert!(widest(&table(&header, &rows)) > LINE_CHARS);
        let folded = folded_table(&header, &rows, 2);
        assert!(widest(&folded) <= LINE_CHARS, "{folded}");
        for table in folded.split("\n\n") {
            let lines: Vec<&str> = table.lines().collect();
            assert!(lines[0].starts_with("column 0  column 1  "), "{table}");
            let names = ["0.0", "1.0", "2.0"];
            assert!(
                lines[2..]
                    .iter()
                    .zip(names)
                    .all(|(line, name)| line.trim().starts_with(name))
            );
        }
        // Every other cell is there once.
        for cell in rows.iter().flat_map(|row| &row[2..]) {
            assert_eq!(
                folded
                    .split_whitespace()
                    .filter(|word| word == cell)
                    .count(),
                1,
                "{cell}"
            );
        }
        assert_eq!(folded_table(&header[..4], &[rows[0][..4].to_vec()], 1), {
            table(&header[..4], &[rows[0][..4].to_vec()])
        });
    }

    #[test]
    fn folded_text_keeps_its_words() {
        let text = "a few words ".repeat(40);
        let folded = folded_text(&text);
        assert!(widest(&folded) <= LINE_CHARS);
        assert!(folded.split_whitespace().eq(text.split_whitespace()));
    }

    #[test]
    fn columns_are_aligned_by_their_kind() {
        let rows = vec![
            vec!["paper".into(), "9.5".into()],
            vec!["organza".into(), "12.25".into()],
        ];
        let expected = "texture  C\n--------------\npaper      9.5\norganza  12.25";
        assert_eq!(table(&["texture", "C"], &rows), expected);
    }
}
