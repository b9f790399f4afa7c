//! Text from other sources, made safe to display.
//!
//! A name in a file, an answer of a device or an argument may contain characters that a terminal executes: they move
//! the cursor, hide a line, or show text backwards. Each such character is replaced by its number.

use std::borrow::Cow;
use std::fmt::Write as _;

use serde::Serialize;

/// Returns `text` with its control characters made visible, except line feeds and tabs.
pub fn visible(text: &str) -> Cow<'_, str> {
    replaced(text, |c| is_obeyed(c) && c != '\n' && c != '\t', number)
}

/// Returns `text` as one line: like [`visible`], with line feeds and tabs made visible too.
pub fn visible_line(text: &str) -> Cow<'_, str> {
    replaced(text, is_obeyed, number)
}

/// Largest number of characters that are kept of an error or a warning: enough for a file's path, its problem and the
/// remedy.
const LONGEST_MESSAGE: usize = 1000;

/// Largest number of successive digits that a message shows.
const MOST_DIGITS: usize = 40;

/// Returns `text` as one line of limited length: like [`visible_line`], but without the middle of a text that a file or
/// device made too long, and without the later digits of a long number. The beginning of a message states the place,
/// and its end the remedy.
pub fn message(text: &str) -> String {
    let mut shown = String::new();
    let mut digits = 0;
    for c in visible_line(text).chars() {
        digits = if c.is_ascii_digit() { digits + 1 } else { 0 };
        match digits {
            0..=MOST_DIGITS => shown.push(c),
            digits if digits == MOST_DIGITS + 1 => shown.push('…'),
            _ => {}
        }
    }
    let Some(left_out) = shown.chars().count().checked_sub(LONGEST_MESSAGE) else {
        return shown;
    };
    let begin: String = shown.chars().take(LONGEST_MESSAGE * 2 / 3).collect();
    let end: String = shown.chars().skip(LONGEST_MESSAGE * 2 / 3 + left_out).collect();
    format!("{begin}… ({left_out} characters left out) …{end}")
}

/// Returns the JSON `text` with the control characters in its strings escaped, which does not change its meaning.
///
/// Line feeds and tabs stay, because they occur only between values: every writer of JSON escapes them in strings.
pub fn visible_json(text: &str) -> Cow<'_, str> {
    replaced(
        text,
        |c| is_obeyed(c) && !matches!(c, '\n' | '\t'),
        |c, out| {
            // All of these characters are in the Basic Multilingual Plane, so one escape is enough.
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        },
    )
}

/// Returns whether a terminal or a page executes `c` instead of showing it: control characters of C0 and C1, DEL,
/// characters that change the direction of text (Unicode Standard Annex #9, section 2), and separators of lines and
/// paragraphs.
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

fn replaced(text: &str, is_replaced: impl Fn(char) -> bool, write: impl Fn(char, &mut String)) -> Cow<'_, str> {
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

/// Returns the JSON of `value` for a page. Nothing in it can end a script element, reverse the direction of text, or
/// count as the end of a line in JavaScript. In an attribute it must also be [`escaped`].
/// Panics if `value` has keys that are not text.
pub fn page_json(value: &impl Serialize) -> String {
    let text = serde_json::to_string(value).expect("the data of pages have text keys only");
    visible_json(&text).replace('<', "\\u003c")
}

/// Returns `text` as it is written in an element or in a quoted attribute of a page. Characters that change the
/// direction of text, or that a page must not contain, are replaced by their numbers.
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

    #[test]
    fn a_message_keeps_its_place_and_its_remedy_whatever_a_file_made_of_it() {
        assert_eq!(message("a.csv: \n is no number"), "a.csv: \\n is no number");
        assert_eq!(message(&format!("{}", 1e300)).chars().count(), MOST_DIGITS + 1);
        let long = format!("a.csv: {}: remove it", "ä".repeat(5_000_000));
        let shown = message(&long);
        assert!(shown.starts_with("a.csv: ä"), "{shown}");
        assert!(shown.ends_with("ä: remove it"), "{shown}");
        assert!(shown.chars().count() < LONGEST_MESSAGE + 50);
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
            let tabbed = visible_json(&json.replace("\n  ", "\n\t")).into_owned();
            for shown in [&*shown, &tabbed] {
                let read: Vec<String> = serde_json::from_str(shown).unwrap();
                prop_assert_eq!(&read[0], &text);
            }
        }

        #[test]
        fn json_of_a_page_keeps_its_meaning_and_ends_no_element(
            text in "\\PC*|[\\x00-\\x9f\u{200e}\u{200f}\u{2028}-\u{202e}a-z<>/&\"'\\\\]*"
        ) {
            let shown = page_json(&[&text]);
            prop_assert!(!shown.contains(|c: char| is_obeyed(c) || c == '<'));
            let read: Vec<String> = serde_json::from_str(&shown).unwrap();
            prop_assert_eq!(&read[0], &text);
            let attribute = escaped(&shown)
                .replace("&quot;", "\"").replace("&#39;", "'").replace("&gt;", ">").replace("&amp;", "&");
            prop_assert_eq!(attribute, shown);
        }
    }
}
