//! Tables as Markdown has them.

use std::fmt::Write;

/// A table with `header` and `rows`; columns after the first are figures, or text without bars.
pub fn table<const COLUMNS: usize>(
    header: [&str; COLUMNS],
    rows: impl IntoIterator<Item = [String; COLUMNS]>,
) -> String {
    let mut text = format!("| {} |\n|{}\n", header.join(" | "), "---|".repeat(COLUMNS));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

/// `number` with a space before every three digits, from five digits on.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    if digits.len() < 5 {
        return digits;
    }
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// A range as text, or the one number that it is.
pub fn range(least: u64, most: u64) -> String {
    if least == most {
        grouped(most)
    } else {
        format!("{} to {}", grouped(least), grouped(most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_from_five_on() {
        for (number, text) in [
            (0, "0"),
            (4530, "4530"),
            (41_285, "41 285"),
            (1_000_000, "1 000 000"),
        ] {
            assert_eq!(grouped(number), text);
        }
        assert_eq!(range(7, 7), "7");
        assert_eq!(range(802, 22_873), "802 to 22 873");
    }

    #[test]
    fn a_table_has_a_header_a_rule_and_its_rows() {
        let rows = [["a".to_owned(), "1".to_owned()]];
        assert_eq!(table(["x", "y"], rows), "| x | y |\n|---|---|\n| a | 1 |\n");
    }
}
