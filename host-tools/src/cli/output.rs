//! Text and JSON on standard output, notes about them on standard error, and wrapping of texts to the lines of a
//! terminal.
//!
//! Two rules hold for all output of a command, so nearly all of it goes through this module. Control characters that
//! came into a text from a file, a device or an argument are shown, so the terminal does not obey them. A closed or
//! full output does not cause a panic. Progress and the question of `stylus settings` are written elsewhere and keep
//! the rules themselves.

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::builder::styling::{AnsiColor, Style};
use console::Term;
use stylus_support::visible::{message, visible, visible_json};
use stylus_support::{Error, Result, progress};
use stylus_support::{Warning, by_kind};

/// True if the user has requested complete output (`--full`).
static IS_FULL: AtomicBool = AtomicBool::new(false);

/// Makes all later output of this process complete: every single warning, and every table.
pub fn be_full() {
    IS_FULL.store(true, Ordering::Relaxed);
}

/// Returns true once [`be_full`] was called.
pub fn is_full() -> bool {
    IS_FULL.load(Ordering::Relaxed)
}

/// Prints to standard output.
pub fn print(text: &str) -> Result<()> {
    print_to(&mut io::stdout().lock(), &visible(text))
}

/// Prints a value as JSON.
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    print(&to_json(value))
}

/// Formats a value as JSON.
pub fn to_json(value: &impl serde::Serialize) -> String {
    let text = serde_json::to_string_pretty(value).expect("reports have text keys only");
    visible_json(&text).into_owned()
}

/// Prints bytes that this program itself has made, such as a script for a shell, to standard output without changes.
pub fn print_exactly(bytes: &[u8]) -> Result<()> {
    let mut output = io::stdout().lock();
    (output.write_all(bytes).and_then(|()| output.flush())).map_err(Error::io("write to", Path::new("standard output")))
}

/// Prints a note about the results on standard error, unless `--quiet` suppresses notes. A closed or full standard
/// error is ignored, because the exit code of a command does not depend on notes.
pub fn note(text: &str) {
    if !progress::is_hidden() {
        tell(text);
    }
}

/// Prints what the user must know, such as a question or an instruction, on standard error. Like [`note`], but also
/// with `--quiet`.
pub fn tell(text: &str) {
    let _ = print_to(&mut io::stderr().lock(), &visible(text));
}

/// Smallest width at which lines are wrapped, columns of the terminal.
const LEAST_COLUMNS: u16 = 40;

/// Prints a warning on standard error, wrapped at the terminal's width; see [`tell`].
pub fn warn(text: &str) {
    let size = Term::stderr().size_checked();
    let width = size.map_or(LINE_CHARS, |(_, columns)| columns.max(LEAST_COLUMNS).into());
    // Wrapped before it is coloured, because an escape sequence takes no place on the line.
    let line = wrapped(&format!("warning: {}", message(text)), width, "  ");
    let rest = line.strip_prefix("warning:").unwrap_or(&line);
    let _ = print_to(&mut io::stderr().lock(), &(yellow("warning:") + rest));
}

/// Prints warnings of recordings and textures: one line per kind, or with `--full` each warning by itself.
pub fn warn_of(warnings: &[Warning]) {
    let lines = if is_full() {
        warnings.iter().map(Warning::to_string).collect()
    } else {
        by_kind(warnings)
    };
    lines.iter().for_each(|line| warn(line));
}

/// Prints the reason why the command failed, in one line on standard error; see [`tell`].
pub fn failed(failure: &Error) {
    let line = format!("{} {}", red("stylus:"), message(&failure.to_string()));
    let _ = print_to(&mut io::stderr().lock(), &line);
}

/// Prints a text that clap has composed: help on standard output, or an error in the command line on standard error.
pub fn answer(answer: &clap::Error) -> Result<()> {
    let styled = answer.render();
    let plain = styled.to_string();
    let plain = plain.trim_end();
    if answer.use_stderr() {
        // clap's own colours are left out here, because its errors quote words of the user, in which control characters
        // have to be shown.
        match plain.split_once(' ') {
            Some((word @ "error:", rest)) => {
                let shown = format!("{} {}", red(word), visible(rest));
                let _ = print_to(&mut io::stderr().lock(), &shown);
            }
            _ => tell(plain),
        }
        return Ok(());
    }
    // Help contains no text from the user, so all its control characters are this program's.
    if takes_colours(&io::stdout()) {
        return print_exactly(format!("{}\n", styled.ansi().to_string().trim_end()).as_bytes());
    }
    print(plain)
}

/// Writes `text` and a line feed, completely or with an error.
fn print_to(output: &mut impl Write, text: &str) -> Result<()> {
    // Flushed here, because an error of the flush at the process's end would be lost.
    output
        .write_all(text.as_bytes())
        .and_then(|()| output.write_all(b"\n"))
        .and_then(|()| output.flush())
        .map_err(Error::io("write to", Path::new("standard output")))
}

/// Returns true if a stream shows colours.
fn takes_colours(stream: &impl IsTerminal) -> bool {
    // By no-color.org any value counts but the empty one.
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    stream.is_terminal() && !is_dumb && !is_set("NO_COLOR")
}

/// Returns `word`, the beginning of an error, coloured if standard error shows colours.
fn red(word: &str) -> String {
    styled(word, AnsiColor::Red)
}

/// Returns `word`, the beginning of a warning, coloured if standard error shows colours.
fn yellow(word: &str) -> String {
    styled(word, AnsiColor::Yellow)
}

fn styled(word: &str, colour: AnsiColor) -> String {
    // Errors and warnings, which alone are coloured here, go to standard error.
    if !takes_colours(&std::io::stderr()) {
        return word.to_owned();
    }
    let style = Style::new().bold().fg_color(Some(colour.into()));
    format!("{style}{word}{style:#}")
}

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
    use test_helpers::holds;

    use super::*;

    /// An output that accepts only this number of bytes.
    struct Full(usize);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = bytes.len().min(self.0);
            self.0 -= taken;
            if taken == 0 {
                return Err(io::Error::from(io::ErrorKind::StorageFull));
            }
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn an_output_that_is_full_is_an_error_wherever_the_text_is_cut() {
        for room in 0..6 {
            let outcome = print_to(&mut Full(room), "table");
            holds(&outcome.unwrap_err().to_string(), &["standard output: cannot write"]);
        }
        assert!(print_to(&mut Full(6), "table").is_ok());
    }

    #[test]
    fn json_with_characters_that_a_terminal_obeys_means_the_same_without_them() {
        let text = to_json(&["a\u{9b}31m\u{202e}b\u{7f}"]);
        assert!(text.is_ascii() && text.contains("\\u009b"), "{text}");
        let read: Vec<String> = serde_json::from_str(&text).unwrap();
        assert_eq!(read, ["a\u{9b}31m\u{202e}b\u{7f}"]);
    }

    #[test]
    fn folded_text_keeps_its_words() {
        let text = "a few words ".repeat(40);
        let folded = folded_text(&text);
        assert!(folded.lines().all(|line| line.chars().count() <= LINE_CHARS));
        assert!(folded.split_whitespace().eq(text.split_whitespace()));
    }
}
