//! Examples at the end of the help of each command. They stand in one page, so that they are read together, and each is
//! parsed by a test.

use clap::Command;

/// One example per line, with a word on it after `#`.
const EXAMPLES: &str = include_str!("examples.txt");

/// The examples of the command that is called `path`, such as `stylus scene check`.
fn examples(path: &str) -> Vec<&'static str> {
    let is_of = |line: &&str| {
        let rest = line.strip_prefix(path);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
    };
    EXAMPLES.lines().filter(is_of).collect()
}

/// Returns `command`, which is called `path`, with examples at the end of the help of each command in it.
pub fn with_examples(command: Command, path: &str) -> Command {
    command.mut_subcommands(|inner| {
        let path = format!("{path} {}", inner.get_name());
        let inner = match examples(&path).as_slice() {
            [] => inner,
            some => inner.after_help(format!("Examples:\n  {}", some.join("\n  "))),
        };
        with_examples(inner, &path)
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::cli::Arguments;

    /// Commands without commands in them, by their names, but for what only programs start.
    fn leaves(command: &Command, path: &str) -> Vec<String> {
        let inner = command
            .get_subcommands()
            .filter(|inner| !inner.is_hide_set());
        let inner = inner.map(|inner| {
            let path = format!("{path} {}", inner.get_name());
            leaves(inner, &path)
        });
        let all: Vec<String> = inner.flatten().collect();
        if all.is_empty() {
            return vec![path.to_owned()];
        }
        all
    }

    #[test]
    fn every_command_has_one_to_three_examples() {
        for command in leaves(&Arguments::command(), "stylus") {
            let count = examples(&command).len();
            assert!(
                (1..=3).contains(&count),
                "{command}: {count} in examples.txt"
            );
        }
    }

    #[test]
    fn every_example_is_a_command_line() {
        for line in EXAMPLES.lines() {
            let line = line.split(" #").next().unwrap_or(line);
            let line = line.split(" > ").next().unwrap_or(line);
            let words = line.split_whitespace().map(|word| word.trim_matches('\''));
            let parsed = with_examples(Arguments::command(), "stylus").try_get_matches_from(words);
            assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
        }
    }
}
