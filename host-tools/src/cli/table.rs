//! Plain text tables.

use host_tools::support::visible::visible_line;

/// `rows` under `header`, columns aligned: text to the left, numbers to the right. A cell is one line, whatever a name
/// in it holds.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

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
