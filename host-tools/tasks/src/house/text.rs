//! Rules on lines: their length, the first words of doc comments, and the lints of packages.

use super::Outcome;
use super::pages::fences;
use super::tree::{Tree, extension};

/// Characters that a line may have.
const MOST: usize = 120;

/// Words that no doc comment begins with.
const QUESTIONS: [&str; 9] = [
    "How", "That", "What", "When", "Where", "Whether", "Which", "Who", "Why",
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

/// Packages with lints of their own: those that have unsafe code, and those of other workspaces.
const OWN_LINTS: [&str; 9] = [
    "stylus-boot",
    "stylus-realtime",
    "stylus-firmware",
    "stylus-browser",
    "stylus-player-c",
    "kernel-guest",
    "fuzz",
    "virtual-stylus",
    "probe-image",
];

/// Checks that every other package takes the workspace's lints, which forbid unsafe code.
pub fn check_lints(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    let manifests = tree.texts_of("toml");
    for (path, text) in manifests.filter(|(path, _)| path.ends_with("Cargo.toml")) {
        let Some((_, package)) = text.split_once("[package]\nname = \"") else {
            continue;
        };
        count += 1;
        let name = package.split('"').next().unwrap_or_default();
        if !text.contains("[lints]\nworkspace = true") && !OWN_LINTS.contains(&name) {
            let problem = "does not inherit the workspace's lints, which forbid unsafe code";
            outcome.find(path, 0, problem);
        }
    }
    outcome.count("packages", count);
}
