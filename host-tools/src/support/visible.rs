//! Text of others, made fit to be shown.
//!
//! A name in a file, an answer of a device or an argument may hold characters that a terminal obeys: they move the
//! cursor, hide a line, or show text backwards. Each of them is shown by its number instead.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Returns `text` with its control characters made visible. Line feeds and tabs stay.
pub fn visible(text: &str) -> Cow<'_, str> {
    replaced(text, |c| is_obeyed(c) && c != '\n' && c != '\t', number)
}

/// Returns `text` in one line: as [`visible`], with line feeds and tabs made visible too.
pub fn visible_line(text: &str) -> Cow<'_, str> {
    replaced(text, is_obeyed, number)
}

/// Returns the JSON `text` with the control characters in its strings escaped, which leaves its meaning.
///
/// A line feed stands between values only, because every writer of JSON escapes those in strings.
pub fn visible_json(text: &str) -> Cow<'_, str> {
    replaced(
        text,
        |c| is_obeyed(c) && c != '\n',
        |c, out| {
            // All of these characters are of the basic plane, which one escape holds.
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        },
    )
}

/// Returns whether a terminal or a page obeys `c` instead of showing it: control characters of C0 and C1, DEL, marks
/// that change the direction of text (Unicode Standard Annex #9, section 2), and separators of lines and paragraphs.
fn is_obeyed(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn number(c: char, out: &mut String) {
    let _ = match c {
        '\n' => write!(out, "\\n"),
        '\t' => write!(out, "\\t"),
        other => write!(out, "\\u{{{:x}}}", u32::from(other)),
    };
}

fn replaced(
    text: &str,
    is_replaced: impl Fn(char) -> bool,
    write: impl Fn(char, &mut String),
) -> Cow<'_, str> {
    if !text.contains(&is_replaced) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_replaced(c) {
            write(c, &mut shown);
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

/// `text` as it stands in an element or in a quoted attribute of a page. Characters that turn the text around or that
/// no page may hold are shown by their numbers.
pub fn escaped(text: &str) -> String {
    let mut html = String::with_capacity(text.len());
    for character in visible(text).chars() {
        match character {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            '"' => html.push_str("&quot;"),
            '\'' => html.push_str("&#39;"),
            other => html.push(other),
        }
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn characters_that_a_terminal_obeys_are_shown_by_their_numbers() {
        let text = "a\u{1b}[2Jb\rc\u{9b}d\u{7f}e\u{202e}f\u{2066}g";
        let shown = "a\\u{1b}[2Jb\\u{d}c\\u{9b}d\\u{7f}e\\u{202e}f\\u{2066}g";
        assert_eq!(visible(text), shown);
        assert_eq!(visible_line("two\nlines\t"), "two\\nlines\\t");
        assert_eq!(visible("two\nlines\t, grüße"), "two\nlines\t, grüße");
    }

    proptest! {
        #[test]
        fn nothing_that_is_shown_is_obeyed(text in "\\PC*|[\\x00-\\x9f\u{202a}-\u{202e}a-z]*") {
            prop_assert!(!visible_line(&text).contains(is_obeyed));
            let rest = |c: char| is_obeyed(c) && c != '\n' && c != '\t';
            prop_assert!(!visible(&text).contains(rest));
        }

        #[test]
        fn json_keeps_its_meaning(text in "[\\x00-\\x9f\u{202a}-\u{202e}a-z\"\\\\]*") {
            let json = serde_json::to_string_pretty(&[&text]).unwrap();
            let shown = visible_json(&json);
            prop_assert!(!shown.contains(|c: char| is_obeyed(c) && c != '\n'));
            let read: Vec<String> = serde_json::from_str(&shown).unwrap();
            prop_assert_eq!(&read[0], &text);
        }
    }
}
