//! Text and JSON on standard output, and notes beside them on standard error.
//!
//! All that a command says goes through here, because two things must hold of all of it: what a file, a device or an
//! argument brought into a text is shown and not obeyed by the terminal, and a closed or full output is no panic.

use std::io::{self, Write};
use std::path::Path;

use host_tools::support::error::{Error, Result};
use host_tools::support::visible::{visible, visible_json, visible_line};

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

/// Says something beside the results, on standard error. Where that is closed or full nobody reads it, and the command
/// goes on: its exit code does not depend on notes.
pub fn note(text: &str) {
    let _ = print_to(&mut io::stderr().lock(), &visible(text));
}

/// Warns of something, in one line on standard error; see [`note`].
pub fn warn(text: &str) {
    note(&format!("warning: {}", visible_line(text)));
}

/// Says why the command failed, in one line on standard error; see [`note`].
pub fn failed(failure: &Error) {
    note(&format!("stylus: {}", visible_line(&failure.to_string())));
}

/// Writes `text` with a line feed, all of it or an error.
fn print_to(output: &mut impl Write, text: &str) -> Result<()> {
    output
        .write_all(text.as_bytes())
        .and_then(|()| output.write_all(b"\n"))
        .and_then(|()| output.flush())
        .map_err(Error::io("write to", Path::new("standard output")))
}

#[cfg(test)]
mod tests {
    use super::*;

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
            assert!(
                message.contains("standard output: cannot write"),
                "{message}"
            );
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
