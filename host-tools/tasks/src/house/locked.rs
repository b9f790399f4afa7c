//! Cargo's commands that build or resolve are locked: they take the versions and checksums of a lock file, or fail.
//!
//! Three places are looked at: scripts, fenced lines of pages, and the functions of `cargo tasks` that start cargo. A
//! function is only asked for the word `--locked`; which of its commands gets it is not followed. Aliases of
//! `.cargo/config.toml` are locked where they are declared.

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use super::finding::Finding;
use super::pages;
use super::source::{Source, each_group};
use super::tree::{Tree, extension};

const LOCKED: &str = "--locked";

/// Folder of the code that starts cargo.
const TASKS: &str = "host-tools/tasks/src/";

/// Cargo's own commands that take a lock file.
const LOCKABLE: [&str; 13] = [
    "bench", "build", "check", "clippy", "doc", "fetch", "install", "metadata", "package",
    "publish", "run", "rustc", "test",
];

/// The number of commands and those without a lock.
pub struct Checked {
    /// The number of commands.
    pub count: usize,
    /// Those without a lock.
    pub findings: Vec<Finding>,
}

/// Checks scripts and pages of `tree`, and those `sources` that start cargo.
pub fn check(tree: &Tree, sources: &[Source]) -> Checked {
    let mut checked = Checked {
        count: 0,
        findings: Vec::new(),
    };
    for (path, text) in tree.texts() {
        let is_shell = ["", "sh"].contains(&extension(path)) && text.starts_with("#!");
        if extension(path) == "md" {
            let fences = pages::fences(text);
            checked.take_text(path, text, |index| fences[index]);
        } else if is_shell {
            checked.take_text(path, text, |_| true);
        }
    }
    for source in sources {
        if source.path.starts_with(TASKS) {
            each_group(&source.tokens, &mut |tokens| {
                checked.take_functions(&source.path, tokens);
            });
        }
    }
    checked
}

impl Checked {
    fn take(&mut self, path: &str, line: usize, command: &str, is_locked: bool) {
        self.count += 1;
        if !is_locked {
            let problem = format!("{command} without {LOCKED}");
            self.findings.push(Finding::new(path, line, problem));
        }
    }

    /// Takes the commands of a text's lines that `is_code` tells by their index.
    fn take_text(&mut self, path: &str, text: &str, is_code: impl Fn(usize) -> bool) {
        let mut lines = text.lines().enumerate();
        while let Some((index, line)) = lines.next() {
            if !is_code(index) {
                continue;
            }
            let mut whole = line.to_owned();
            while let Some(begun) = whole.strip_suffix('\\') {
                let next = lines.next().map_or("", |(_, next)| next);
                whole = format!("{begun} {next}");
            }
            for (subcommand, is_locked) in commands(&whole) {
                self.take(path, index + 1, &format!("`cargo {subcommand}`"), is_locked);
            }
        }
    }

    /// Takes the functions among `tokens`, the inside of one group.
    fn take_functions(&mut self, path: &str, tokens: &[TokenTree]) {
        for (index, token) in tokens.iter().enumerate() {
            let TokenTree::Ident(word) = token else {
                continue;
            };
            let body = tokens[index..].iter().find_map(|token| match token {
                TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                    Some(group.stream())
                }
                _ => None,
            });
            if let (true, Some(body)) = (*word == "fn", body)
                && starts_cargo(&body)
            {
                let line = word.span().start().line;
                let is_locked = has_text(&body, LOCKED);
                self.take(path, line, "a function that starts cargo", is_locked);
            }
        }
    }
}

/// The subcommands of cargo in a shell's line that take a lock file, with true for those that are locked.
fn commands(line: &str) -> Vec<(&str, bool)> {
    let words = line.split_whitespace();
    let words: Vec<&str> = words.take_while(|word| !word.starts_with('#')).collect();
    let mut commands = Vec::new();
    for (place, word) in words.iter().enumerate() {
        // `$(cargo ...)` is a command, too.
        if word.rsplit(['(', '`']).next() != Some("cargo") {
            continue;
        }
        let mut rest = words[place + 1..].iter().copied().peekable();
        rest.next_if(|word| word.starts_with('+'));
        let Some(subcommand) = rest.next().filter(|word| LOCKABLE.contains(word)) else {
            continue;
        };
        let is_end =
            |word: &&str| ["--", "&&", "||", "|", ";"].contains(word) || word.ends_with(';');
        let is_locked = rest
            .take_while(|word| !is_end(word))
            .any(|word| word == LOCKED);
        commands.push((subcommand, is_locked));
    }
    commands
}

/// True where a `Command` is made of a path with `cargo` in it.
fn starts_cargo(stream: &TokenStream) -> bool {
    let mut starts = false;
    each_group(stream, &mut |tokens| {
        for five in tokens.windows(5) {
            if let [
                TokenTree::Ident(of),
                _,
                _,
                TokenTree::Ident(new),
                TokenTree::Group(program),
            ] = five
            {
                starts |= *of == "Command" && *new == "new" && has_text(&program.stream(), "cargo");
            }
        }
    });
    starts
}

/// True where `stream` has the literal `text`.
fn has_text(stream: &TokenStream, text: &str) -> bool {
    let literal = format!("{text:?}");
    let mut has = false;
    each_group(stream, &mut |tokens| {
        has |= tokens.iter().any(
            |token| matches!(token, TokenTree::Literal(found) if found.to_string() == literal),
        );
    });
    has
}

#[cfg(test)]
mod tests {
    use super::super::source;
    use super::*;

    fn found(path: &str, text: &str) -> (usize, Vec<String>) {
        let tree = Tree::of(&[(path, text)]);
        let checked = check(&tree, &source::parse(&tree).0);
        let findings = checked.findings.iter().map(ToString::to_string);
        (checked.count, findings.collect())
    }

    #[test]
    fn a_command_of_a_script_that_is_not_locked_is_found() {
        let text = "#!/bin/sh\n# cargo test\nx=$(cargo build --quiet) && cargo test --locked\ncargo +nightly run \\\n\
                    \t--locked | cargo bench -- --locked\ncargo fmt && cargo tasks house\n";
        let (count, findings) = found("tests/run", text);
        assert_eq!(count, 4);
        assert_eq!(
            findings,
            [
                "tests/run:3: `cargo build` without --locked",
                "tests/run:4: `cargo bench` without --locked"
            ]
        );
        assert_eq!(found("LICENSE", "cargo test\n").0, 0);
    }

    #[test]
    fn a_command_in_a_fence_of_a_page_that_is_not_locked_is_found() {
        let text =
            "cargo test\n```\nA=1 cargo test -p a  # --locked\ncargo add b\n```\n`cargo run`\n";
        assert_eq!(
            found("README.md", text),
            (
                1,
                vec!["README.md:3: `cargo test` without --locked".to_owned()]
            )
        );
    }

    #[test]
    fn a_function_of_tasks_that_starts_cargo_and_does_not_lock_it_is_found() {
        let text = "fn a() { Command::new(\"cargo\").args([\"test\", \"--locked\"]); }\n\
                    impl B { fn b(&self) -> C { match self { B => Command::new(D.join(\"cargo\")) } } }\n\
                    fn e() { Command::new(\"git\").arg(\"cargo\"); }\n";
        let path = "host-tools/tasks/src/a.rs";
        assert_eq!(
            found(path, text),
            (
                2,
                vec![format!(
                    "{path}:2: a function that starts cargo without --locked"
                )]
            )
        );
        assert_eq!(found("host-tools/src/a.rs", text).0, 0);
    }
}
