//! The pages against the command: each command is described, and no option is named that there is not.

use std::collections::BTreeSet;
use std::process::Command;

const COMMANDS: &str = include_str!("../../host-tools/COMMANDS.md");

/// Pages that name options of `stylus`.
const PAGES: [(&str, &str); 4] = [
    ("README.md", include_str!("../../README.md")),
    ("host-tools/COMMANDS.md", COMMANDS),
    (
        "host-tools/SCENES.md",
        include_str!("../../host-tools/SCENES.md"),
    ),
    (
        "host-tools/FORMATS.md",
        include_str!("../../host-tools/FORMATS.md"),
    ),
];

/// Commands that only lead to others.
const GROUPS: [&str; 2] = ["scene", "settings"];

/// Options of other programs that the pages name.
const OF_OTHERS: [&str; 1] = ["--port"];

/// What `stylus` prints for `arguments` and `--help`.
fn help(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_stylus"))
        .args(arguments)
        .arg("--help")
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).expect("help is text")
}

/// The names in the list of commands that `help` has.
fn commands(help: &str) -> Vec<String> {
    let list = help.split_once("Commands:\n").map_or("", |(_, list)| list);
    let names = list
        .lines()
        .take_while(|line| line.starts_with("  "))
        .filter_map(|line| line.split_whitespace().next());
    names
        .filter(|&name| name != "help")
        .map(str::to_owned)
        .collect()
}

/// Everything in `text` that looks like a long option.
fn options(text: &str) -> BTreeSet<&str> {
    let is_of_option = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let words = text.split(|c: char| !is_of_option(c));
    words
        .filter(|word| word.len() > 3 && word.starts_with("--") && !word.starts_with("---"))
        .collect()
}

#[test]
fn every_command_is_described() {
    let top = commands(&help(&[]));
    assert!(top.len() > 10, "{top:?}");
    for command in &top {
        let named = format!("`stylus {command}");
        assert!(COMMANDS.contains(&named), "COMMANDS.md has no {named}`");
    }
}

#[test]
fn every_option_that_a_page_names_is_there() {
    let mut helps = vec![help(&[])];
    for command in commands(&helps[0]) {
        let text = help(&[&command]);
        if GROUPS.contains(&command.as_str()) {
            let inner = commands(&text).into_iter();
            helps.extend(inner.map(|inner| help(&[&command, &inner])));
        }
        helps.push(text);
    }
    let known: BTreeSet<&str> = helps.iter().flat_map(|help| options(help)).collect();
    for (page, text) in PAGES {
        for option in options(text) {
            assert!(
                known.contains(option) || OF_OTHERS.contains(&option),
                "{page} names {option}, which no command has"
            );
        }
    }
}
