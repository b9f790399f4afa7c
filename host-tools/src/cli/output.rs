//! Text and JSON on standard output, and notes beside them on standard error.
//!
//! All that a command says goes through here, because two things must hold of all of it: what a file, a device or an
//! argument brought into a text is shown and not obeyed by the terminal, and a closed or full output is no panic.

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::builder::styling::{AnsiColor, Style};
use console::Term;
use host_tools::support::error::{Error, Result};
use host_tools::support::progress;
use host_tools::support::visible::{message, visible, visible_json};
use host_tools::support::warning::{Warning, by_kind};

use super::lines::{LINE_CHARS, wrapped};

/// True if the user has asked for everything there is to say.
static IS_FULL: AtomicBool = AtomicBool::new(false);

/// Makes all that this process says complete from now on: every warning by itself, and every table.
pub fn be_full() {
    IS_FULL.store(true, Ordering::Relaxed);
}

/// Returns true once [`be_full`] was called.
pub fn is_full() -> bool {
    IS_FULL.load(Ordering::Relaxed)
}

/// Prints to standard output.
///
/// # Errors
/// An output that does not take all of it.
pub fn print(text: &str) -> Result<()> {
    print_to(&mut io::stdout().lock(), &visible(text))
}

/// Prints a value as JSON.
///
/// # Errors
/// As [`print()`].
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    print(&to_json(value))
}

/// Formats a value as JSON.
pub fn to_json(value: &impl serde::Serialize) -> String {
    let text = serde_json::to_string_pretty(value).expect("reports have text keys only");
    visible_json(&text).into_owned()
}

/// Prints bytes of this program's own making to standard output as they are, such as a script for a shell.
///
/// # Errors
/// As [`print()`].
pub fn print_exactly(bytes: &[u8]) -> Result<()> {
    let mut output = io::stdout().lock();
    (output.write_all(bytes).and_then(|()| output.flush()))
        .map_err(Error::io("write to", Path::new("standard output")))
}

/// Says something beside the results, on standard error, unless `--quiet` leaves that out. Where standard error is
/// closed or full nobody reads it, and the command goes on: its exit code does not depend on notes.
pub fn note(text: &str) {
    if !progress::is_hidden() {
        tell(text);
    }
}

/// Tells the person at the keyboard what must be known, such as a question or what to do now; as [`note`], also with
/// `--quiet`.
pub fn tell(text: &str) {
    let _ = print_to(&mut io::stderr().lock(), &visible(text));
}

/// Fewest columns of a terminal that lines are wrapped at.
const LEAST_COLUMNS: u16 = 40;

/// Warns of something on standard error, wrapped at the terminal's width; see [`tell`].
pub fn warn(text: &str) {
    let size = Term::stderr().size_checked();
    let width = size.map_or(LINE_CHARS, |(_, columns)| columns.max(LEAST_COLUMNS).into());
    let line = wrapped(&format!("warning: {}", message(text)), width, "  ");
    let rest = line.strip_prefix("warning:").unwrap_or(&line);
    let _ = print_to(&mut io::stderr().lock(), &(yellow("warning:") + rest));
}

/// Warns of recordings and textures: in a line per kind, or with `--full` of each by itself.
pub fn warn_of(warnings: &[Warning]) {
    let lines = if is_full() {
        warnings.iter().map(Warning::to_string).collect()
    } else {
        by_kind(warnings)
    };
    lines.iter().for_each(|line| warn(line));
}

/// Says why the command failed, in one line on standard error; see [`tell`].
pub fn failed(failure: &Error) {
    let line = format!("{} {}", red("stylus:"), message(&failure.to_string()));
    let _ = print_to(&mut io::stderr().lock(), &line);
}

/// Prints a text that clap has made: the help on standard output, or the fault of a command line on standard error.
///
/// # Errors
/// As [`print()`], for help.
pub fn answer(answer: &clap::Error) -> Result<()> {
    let styled = answer.render();
    let plain = styled.to_string();
    let plain = plain.trim_end();
    if answer.use_stderr() {
        match plain.split_once(' ') {
            Some((word @ "error:", rest)) => {
                let shown = format!("{} {}", red(word), visible(rest));
                let _ = print_to(&mut io::stderr().lock(), &shown);
            }
            _ => tell(plain),
        }
        return Ok(());
    }
    // No value of a user's is in the help, so that its marks are those of this program.
    if takes_colours(&io::stdout()) {
        return print_exactly(format!("{}\n", styled.ansi().to_string().trim_end()).as_bytes());
    }
    print(plain)
}

/// Writes `text` with a line feed, all of it or an error.
fn print_to(output: &mut impl Write, text: &str) -> Result<()> {
    output
        .write_all(text.as_bytes())
        .and_then(|()| output.write_all(b"\n"))
        .and_then(|()| output.flush())
        .map_err(Error::io("write to", Path::new("standard output")))
}

/// Returns true if a stream takes colours.
fn takes_colours(stream: &impl IsTerminal) -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    stream.is_terminal() && !is_dumb && !is_set("NO_COLOR")
}

/// `word`, at the beginning of an error, as standard error takes it.
fn red(word: &str) -> String {
    styled(word, AnsiColor::Red)
}

/// `word`, at the beginning of a warning, as standard error takes it.
fn yellow(word: &str) -> String {
    styled(word, AnsiColor::Yellow)
}

fn styled(word: &str, colour: AnsiColor) -> String {
    if !takes_colours(&std::io::stderr()) {
        return word.to_owned();
    }
    let style = Style::new().bold().fg_color(Some(colour.into()));
    format!("{style}{word}{style:#}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    /// An output with room for so many bytes.
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
            let message = outcome.unwrap_err().to_string();
            holds(&message, &["standard output: cannot write"]);
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
}
