//! Compares the pages with the command: every command is described, and every option that is named exists.

use std::collections::BTreeSet;
use std::process::Command;

use model_format::link::Setting;

const COMMANDS: &str = include_str!("../../host-tools/manual/COMMANDS.md");

/// Pages that name options of `stylus`.
const PAGES: [(&str, &str); 6] = [
    ("README.md", include_str!("../../README.md")),
    ("TUTORIAL.md", include_str!("../../TUTORIAL.md")),
    ("firmware/BRINGUP.md", BRINGUP),
    ("host-tools/manual/COMMANDS.md", COMMANDS),
    (
        "host-tools/manual/SCENES.md",
        include_str!("../../host-tools/manual/SCENES.md"),
    ),
    (
        "host-tools/manual/FORMATS.md",
        include_str!("../../host-tools/manual/FORMATS.md"),
    ),
];

/// The page of a board's first hour. It names options of `cargo tasks` too.
const BRINGUP: &str = include_str!("../../firmware/BRINGUP.md");

/// The sources of `cargo tasks hil`, whose fields have the names of its options.
const HIL: &str = concat!(
    include_str!("../../host-tools/tasks/src/hil.rs"),
    include_str!("../hil/src/main.rs")
);

/// Commands that only group other commands.
const GROUPS: [&str; 2] = ["scene", "settings"];

/// Options of other programs that the pages name.
const OF_OTHERS: [&str; 5] = ["--path", "--port", "--version", "--range", "--warm"];

/// Options of `cargo tasks hil` that are named only in pages about boards.
const OF_HIL: [&str; 2] = ["--flash", "--minutes"];

/// The output of `stylus` with `arguments` and `--help`.
fn help(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_stylus"))
        .args(arguments)
        .arg("--help")
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).expect("help is text")
}

/// The names in the lists of commands in `help`.
pub fn commands(help: &str) -> Vec<String> {
    help.split("\nOptions:")
        .next()
        .unwrap_or_default()
        .lines()
        .filter_map(|line| line.strip_prefix("  "))
        .filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|&name| name != "help")
        .map(str::to_owned)
        .collect()
}

/// Everything in `text` that looks like a long option.
fn options(text: &str) -> BTreeSet<&str> {
    let is_of_option = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    text.split(|c: char| !is_of_option(c))
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
                known.contains(option)
                    || OF_OTHERS.contains(&option)
                    || page == "firmware/BRINGUP.md" && OF_HIL.contains(&option),
                "{page} names {option}, which no command has"
            );
        }
    }
}

/// The command lines in `page`: the lines in code blocks without a language.
fn command_lines(page: &str) -> Vec<&str> {
    let mut fence = None;
    let mut lines = Vec::new();
    for line in page.lines() {
        match (line.strip_prefix("```"), fence) {
            (Some(language), None) => fence = Some(language),
            (Some(_), Some(_)) => fence = None,
            (None, Some("")) => lines.push(line),
            (None, _) => {}
        }
    }
    lines
}

#[test]
fn every_command_of_a_boards_first_hour_is_one() {
    let lines = command_lines(BRINGUP);
    let mut tried = 0;
    for line in lines.iter().filter(|line| !line.is_empty()) {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["cargo", "stylus", ref arguments @ ..] => {
                // With --help at the end, all arguments before it are parsed, and nothing is done.
                let output = Command::new(env!("CARGO_BIN_EXE_stylus"))
                    .args(arguments)
                    .arg("--help")
                    .output()
                    .expect("it runs");
                assert!(output.status.success(), "{line}: {output:?}");
                let known = help(&arguments[..1]);
                let inner = (GROUPS.contains(&arguments[0]) && arguments.len() > 1).then(|| help(&arguments[..2]));
                let known = known + inner.as_deref().unwrap_or_default();
                for option in options(line).into_iter().filter(|&one| one != "--version") {
                    assert!(options(&known).contains(option), "{line}: no {option}");
                }
                tried += 1;
            }
            ["cargo", "tasks", "hil", ..] => {
                for option in options(line) {
                    let field = format!("    {}: ", option.trim_start_matches('-').replace('-', "_"));
                    assert!(HIL.contains(&field), "{line}: no {option}");
                }
                tried += 1;
            }
            ["cargo", "tasks", "setup" | "firmware"] | ["cargo", "flash" | "demo"] | ["export", _] => {}
            _ => panic!("firmware/BRINGUP.md has a command that nobody checks: {line}"),
        }
    }
    assert!(tried > 10, "{tried}");
}

#[test]
fn every_setting_of_a_boards_first_hour_is_one_and_in_range() {
    let lines = command_lines(BRINGUP);
    let words = lines.iter().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let mut set = 0;
    for words in words {
        if let ["cargo", "stylus", "settings", "set", name, value] = words[..] {
            let setting = Setting::named(name).unwrap_or_else(|| panic!("no setting {name}"));
            let value = value.parse().unwrap_or_else(|_| panic!("{name}: {value}"));
            assert!(setting.check(value).is_ok(), "{name}: {value}");
            set += 1;
        }
    }
    assert!(set > 2, "{set}");
}
