//! Rules on lines: their length, the first words of doc comments, and `--locked` in cargo's commands.

use super::Outcome;
use super::pages::fences;
use super::tree::{Tree, extension};

/// Characters that a line may have.
const MOST: usize = 120;

/// Words that no doc comment begins with.
const QUESTIONS: [&str; 9] = [
    "How", "That", "What", "When", "Where", "Whether", "Which", "Who", "Why",
];

/// Cargo's own commands that take a lock file. Aliases are locked where `.cargo/config.toml` declares them.
const LOCKABLE: [&str; 13] = [
    "bench", "build", "check", "clippy", "doc", "fetch", "install", "metadata", "package",
    "publish", "run", "rustc", "test",
];

fn is_script(path: &str, text: &str) -> bool {
    ["", "sh"].contains(&extension(path)) && text.starts_with("#!")
}

/// Checks the length of lines of code, scripts and pages. Rows of tables and lines of one link cannot be broken.
pub fn check_lines(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    for (path, text) in tree.texts() {
        if extension(path).is_empty() && !is_script(path, text) {
            continue;
        }
        count += 1;
        let is_page = extension(path) == "md";
        let fences = fences(text);
        for (index, line) in text.lines().enumerate() {
            let length = line.chars().count();
            let is_row =
                line.trim_start().starts_with('|') || fences[index] && line.contains(['|', '│']);
            let is_link = line.contains("](") && line.matches(' ').count() < 4;
            if length > MOST && !(is_page && (is_row || is_link)) {
                let problem = format!("{length} characters: a line has at most {MOST}");
                outcome.find(path, index + 1, problem);
            }
        }
    }
    outcome.count("files", count);
}

/// Checks the first word of every doc comment. Lines that follow each other are one comment.
pub fn check_doc_comments(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    for (path, text) in tree.texts_of("rs") {
        let mut is_within = false;
        for (index, line) in text.lines().enumerate() {
            let line = line.trim_start();
            let comment = line.strip_prefix("///").or(line.strip_prefix("//!"));
            let Some(comment) = comment else {
                is_within = false;
                continue;
            };
            let text = comment.trim_start_matches(|first: char| !first.is_alphanumeric());
            if is_within || text.is_empty() {
                continue;
            }
            is_within = true;
            count += 1;
            let word = text.split(|next: char| !next.is_alphanumeric()).next();
            if let Some(word) = word.filter(|word| QUESTIONS.contains(word)) {
                let problem = format!(
                    "a doc comment begins with '{word}': begin with a noun phrase or a verb in the third person"
                );
                outcome.find(path, index + 1, problem);
            }
        }
    }
    outcome.count("doc comments", count);
}

/// Checks that cargo's commands take the versions of a lock file, or fail: in scripts, in fences of pages, and in files
/// of `cargo tasks` that start cargo.
pub fn check_locked(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    for (path, text) in tree.texts() {
        let is_page = extension(path) == "md";
        if is_page || is_script(path, text) {
            let fences = fences(text);
            let mut whole = String::new();
            for (index, line) in text.lines().enumerate() {
                if is_page && !fences[index] {
                    continue;
                }
                whole.push_str(line.strip_suffix('\\').unwrap_or(line));
                if line.ends_with('\\') {
                    continue;
                }
                for (subcommand, is_locked) in commands(&whole) {
                    count += 1;
                    if !is_locked {
                        let problem = format!("`cargo {subcommand}` without --locked");
                        outcome.find(path, index + 1, problem);
                    }
                }
                whole.clear();
            }
        } else if path.starts_with("host-tools/tasks/src/")
            && text.contains("Command::new(\"cargo\")")
        {
            count += 1;
            if !text.contains("\"--locked\"") {
                outcome.find(path, 0, "starts cargo without --locked");
            }
        }
    }
    outcome.count("commands of cargo", count);
}

/// The subcommands of cargo in a shell's line that take a lock file, with true for those that are locked.
fn commands(line: &str) -> Vec<(&str, bool)> {
    let words = line.split_whitespace();
    let words: Vec<&str> = words.take_while(|word| !word.starts_with('#')).collect();
    let is_cargo = |word: &str| word.rsplit(['(', '`']).next() == Some("cargo");
    let is_end = |word: &&&str| ["--", "&&", "||", "|", ";"].contains(*word) || word.ends_with(';');
    let mut commands = Vec::new();
    for place in (0..words.len()).filter(|&place| is_cargo(words[place])) {
        let rest = &words[place + 1..];
        if let Some(subcommand) = rest.first().filter(|word| LOCKABLE.contains(word)) {
            let arguments = rest.iter().take_while(|word| !is_end(word));
            let is_locked = arguments
                .map(|word| word.trim_end_matches(')'))
                .any(|word| word == "--locked");
            commands.push((*subcommand, is_locked));
        }
    }
    commands
}
