//! Wrapping of texts to the lines of a terminal.

/// Width at which texts and tables are wrapped, characters.
pub const LINE_CHARS: usize = 80;

/// Breaks `text` at spaces into lines of at most [`LINE_CHARS`] characters. A longer word has a longer line.
pub fn folded_text(text: &str) -> String {
    wrapped(text, LINE_CHARS, "")
}

/// Breaks `text` at spaces into lines of at most `width` characters. Lines after a break begin with `indent`. A word
/// longer than `width` has a longer line.
pub fn wrapped(text: &str, width: usize, indent: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        // Split at every single space, so that runs of spaces stay. The first word never begins a new line: the line
        // before would be empty.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folded_text_keeps_its_words() {
        let text = "a few words ".repeat(40);
        let folded = folded_text(&text);
        assert!(folded.lines().all(|line| line.chars().count() <= LINE_CHARS));
        assert!(folded.split_whitespace().eq(text.split_whitespace()));
    }
}
