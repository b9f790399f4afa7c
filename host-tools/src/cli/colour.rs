//! Colour of help, warnings and errors.

use std::ffi::OsString;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::ColorChoice;
use clap::builder::styling::{AnsiColor, Style};

/// Name of the option.
const OPTION: &str = "--color";

/// True if standard error takes colours.
static ON_ERRORS: AtomicBool = AtomicBool::new(false);

/// True if standard output takes colours.
static ON_RESULTS: AtomicBool = AtomicBool::new(false);

/// A choice of colours, and who made it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    pub choice: ColorChoice,
    /// The command line made it, and wins over `NO_COLOR`.
    pub is_given: bool,
}

impl Choice {
    /// The choice among the words of a command line that is not parsed, or `otherwise`.
    pub fn among(words: impl Iterator<Item = OsString>, otherwise: ColorChoice) -> Self {
        let mut words = words.filter_map(|word| word.into_string().ok());
        let mut found = None;
        while let Some(word) = words.next().filter(|word| word != "--") {
            let value = match word.strip_prefix(OPTION) {
                Some("") => words.next(),
                Some(rest) => rest.strip_prefix('=').map(str::to_owned),
                None => None,
            };
            let value = value.and_then(|value| value.parse().ok());
            found = value.or(found);
        }
        Self {
            choice: found.unwrap_or(otherwise),
            is_given: found.is_some(),
        }
    }

    /// Returns true if a stream takes colours.
    fn is_on(self, around: Around) -> bool {
        match self.choice {
            ColorChoice::Never => false,
            ColorChoice::Always => self.is_given || !around.has_no_color,
            ColorChoice::Auto => around.is_terminal && !around.is_dumb && !around.has_no_color,
        }
    }

    /// Makes it the choice of this process.
    pub fn take(self) {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let around = |is_terminal| Around {
            is_terminal,
            is_dumb: set("TERM").is_some_and(|value| value == "dumb"),
            has_no_color: set("NO_COLOR").is_some(),
        };
        let on_errors = self.is_on(around(std::io::stderr().is_terminal()));
        let on_results = self.is_on(around(std::io::stdout().is_terminal()));
        ON_ERRORS.store(on_errors, Ordering::Relaxed);
        ON_RESULTS.store(on_results, Ordering::Relaxed);
    }
}

/// A stream and its environment.
#[derive(Clone, Copy, Debug)]
struct Around {
    is_terminal: bool,
    /// The terminal is one without colours, by `TERM`.
    is_dumb: bool,
    /// `NO_COLOR` is set and not empty (<https://no-color.org>).
    has_no_color: bool,
}

/// Returns true if standard output takes colours.
pub fn on_results() -> bool {
    ON_RESULTS.load(Ordering::Relaxed)
}

/// `word`, at the beginning of an error, as standard error takes it.
pub fn error(word: &str) -> String {
    styled(word, AnsiColor::Red)
}

/// `word`, at the beginning of a warning, as standard error takes it.
pub fn warning(word: &str) -> String {
    styled(word, AnsiColor::Yellow)
}

fn styled(word: &str, colour: AnsiColor) -> String {
    if !ON_ERRORS.load(Ordering::Relaxed) {
        return word.to_owned();
    }
    let style = Style::new().bold().fg_color(Some(colour.into()));
    format!("{style}{word}{style:#}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TERMINAL: Around = Around {
        is_terminal: true,
        is_dumb: false,
        has_no_color: false,
    };

    fn among(words: &[&str]) -> Choice {
        Choice::among(words.iter().map(OsString::from), ColorChoice::Auto)
    }

    #[test]
    fn the_command_line_wins_over_the_environment_and_that_over_the_file() {
        let pipe = Around {
            is_terminal: false,
            ..TERMINAL
        };
        let no_color = Around {
            has_no_color: true,
            ..TERMINAL
        };
        let dumb = Around {
            is_dumb: true,
            ..TERMINAL
        };
        let by_file = |choice| Choice {
            choice,
            is_given: false,
        };
        let by_line = |choice| Choice {
            choice,
            is_given: true,
        };
        assert!(by_file(ColorChoice::Auto).is_on(TERMINAL));
        for around in [pipe, no_color, dumb] {
            assert!(!by_file(ColorChoice::Auto).is_on(around));
            assert!(!by_line(ColorChoice::Auto).is_on(around));
            assert!(!by_file(ColorChoice::Never).is_on(around));
            assert!(by_line(ColorChoice::Always).is_on(around));
        }
        assert!(!by_line(ColorChoice::Never).is_on(TERMINAL));
        assert!(by_file(ColorChoice::Always).is_on(pipe));
        assert!(!by_file(ColorChoice::Always).is_on(no_color));
    }

    #[test]
    fn a_line_that_cannot_be_parsed_has_its_choice_all_the_same() {
        let always = Choice {
            choice: ColorChoice::Always,
            is_given: true,
        };
        for words in [
            &["stylus", "fti", "--color", "always"][..],
            &["stylus", "--color=always", "fti"],
            &["stylus", "--color", "never", "fti", "--color=always"],
            &["stylus", "--color=always", "--", "--color=never"],
        ] {
            assert_eq!(among(words), always, "{words:?}");
        }
        for words in [
            &["stylus"][..],
            &["stylus", "--color"],
            &["stylus", "--color", "blue"],
            &["stylus", "--colors=always"],
            &["stylus", "--", "--color=always"],
        ] {
            assert!(!among(words).is_given, "{words:?}");
        }
    }
}
