//! Colour of help, warnings and errors: on a terminal, unless `NO_COLOR` is set (<https://no-color.org>).

use std::io::IsTerminal;

use clap::builder::styling::{AnsiColor, Style};

/// Returns true if a stream takes colours.
pub fn is_on(stream: &impl IsTerminal) -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    stream.is_terminal() && !is_dumb && !is_set("NO_COLOR")
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
    if !is_on(&std::io::stderr()) {
        return word.to_owned();
    }
    let style = Style::new().bold().fg_color(Some(colour.into()));
    format!("{style}{word}{style:#}")
}
