//! The help, the manual pages and the completions in shells: all that is said of commands apart from running them.
//!
//! The help has groups of commands on its first screen, and examples at the end of each command's own. Examples are
//! kept in one file, so that they can be read together. A test parses each of them.

use std::path::Path;

use clap::Command;
use clap::builder::StyledStr;
use clap_complete::Shell;
use clap_mangen::Man;
use stylus_support::{Error, Result};

use super::output::print_exactly;

/// One example per line, with a short explanation after `#`.
const EXAMPLES: &str = include_str!("examples.txt");

/// The commands on the first screen of the help, in the groups of the manual's page of commands.
const GROUPS: [(&str, &str); 6] = [
    ("Recordings", "trials record simulate-rig"),
    ("Models", "fit join inspect import-hatt"),
    ("Judging", "evaluate compare page stress frontier"),
    ("Playing on the computer", "render export scene"),
    (
        "The stylus",
        "devices status upload slots play stop settings selftest calibrate check headroom update",
    ),
    ("This program", "demo completions man help"),
];

/// Returns `command`, the whole one, with all of its help.
pub fn whole(command: Command) -> Command {
    with_groups(with_short_outputs(with_examples(command, "stylus")))
}

/// Returns `command` with its subcommands in groups on the first screen of its help.
fn with_groups(command: Command) -> Command {
    let (heading, name_style) = (*command.get_styles().get_header(), *command.get_styles().get_literal());
    let mut text = String::from("{about}\n\n{usage-heading} {usage}\n");
    for (group, names) in GROUPS {
        text += &format!("\n{heading}{group}:{heading:#}\n");
        for name in names.split(' ') {
            let about = command
                .find_subcommand(name)
                .and_then(Command::get_about)
                .map_or_else(|| "Print the help of a command".to_owned(), StyledStr::to_string);
            text += &format!("  {name_style}{name:<12}{name_style:#}  {about}\n");
        }
    }
    command
        .help_template(text + &format!("\n{heading}Options:{heading:#}\n{{options}}{{after-help}}"))
        .after_help("Begin: stylus demo")
}

/// Returns the examples of the command called `path`, such as `stylus scene check`, and of its subcommands.
fn examples(path: &str) -> Vec<&'static str> {
    let is_of = |line: &&str| {
        let rest = line.strip_prefix(path);
        // The name of a command may be the beginning of another one's.
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
    };
    EXAMPLES.lines().filter(is_of).collect()
}

/// Returns `command`, which is called `path`, with examples at the end of the help of each of its subcommands.
fn with_examples(command: Command, path: &str) -> Command {
    command.mut_subcommands(|inner| {
        let path = format!("{path} {}", inner.get_name());
        let inner = match examples(&path).as_slice() {
            // A command that only programs start has no examples, and so no empty list of them.
            [] => inner,
            some => inner.after_help(format!("Examples:\n  {}", some.join("\n  "))),
        };
        with_examples(inner, &path)
    })
}

/// Adds `-o` and `--output`, which most programs have, as other names of `--out` to every command that has it.
fn with_short_outputs(command: Command) -> Command {
    command.mut_subcommands(|inner| {
        // Asked by the long name, because the `out` of `record` is positional. A short name would make it an option.
        let has_output = inner.get_arguments().any(|argument| argument.get_long() == Some("out"));
        let inner = if has_output {
            inner.mut_arg("out", |out| out.short('o').alias("output"))
        } else {
            inner
        };
        with_short_outputs(inner)
    })
}

#[derive(clap::Args)]
pub struct CompletionsArguments {
    /// Shell that the script is for
    shell: Shell,
}

#[derive(clap::Args)]
pub struct ManArguments {
    /// Command, such as fit or scene check; the whole program without one
    command: Vec<String>,
}

/// Prints the script that completes the words of `command`, the whole one.
pub fn completions(arguments: &CompletionsArguments, command: &mut Command) -> Result<()> {
    print_exactly(&script(arguments.shell, command))
}

fn script(shell: Shell, command: &mut Command) -> Vec<u8> {
    let mut script = Vec::new();
    clap_complete::generate(shell, command, "stylus", &mut script);
    script
}

/// Prints the page of a command within `command`, the whole one.
pub fn man(arguments: &ManArguments, command: &mut Command) -> Result<()> {
    print_exactly(&page(&arguments.command, command)?)
}

fn page(names: &[String], command: &mut Command) -> Result<Vec<u8>> {
    command.build();
    let mut found = &*command;
    for name in names {
        found = found.find_subcommand(name).ok_or_else(|| {
            let path = names.join(" ");
            Error::Request(format!("there is no command '{path}'; `stylus --help` lists them"))
        })?;
    }
    let mut page = Vec::new();
    Man::new(found.clone())
        .render(&mut page)
        .map_err(Error::io("write to", Path::new("standard output")))?;
    Ok(page)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use clap::builder::PossibleValue;
    use clap::{CommandFactory, ValueEnum};

    use super::*;
    use crate::cli::{self, Arguments};

    /// Names of the commands without subcommands, except those that only programs start.
    fn leaves(command: &Command, path: &str) -> Vec<String> {
        let inner = command.get_subcommands().filter(|inner| !inner.is_hide_set());
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
    fn the_first_screen_has_every_command_once_on_one_line_and_ends_with_where_to_begin() {
        let shown = whole(Arguments::command()).render_help().to_string();
        let mut named: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.split(' ')).collect();
        let mut all = Arguments::command();
        all.build();
        let mut there: Vec<&str> = all.get_subcommands().map(Command::get_name).collect();
        named.sort_unstable();
        there.sort_unstable();
        assert_eq!(named, there);
        for line in shown.lines() {
            assert!(line.chars().count() <= 100, "{line}");
        }
        assert!(shown.trim_end().ends_with("\nBegin: stylus demo"), "{shown}");
    }

    #[test]
    fn every_command_has_one_to_three_examples() {
        for command in leaves(&Arguments::command(), "stylus") {
            let count = examples(&command).len();
            assert!((1..=3).contains(&count), "{command}: {count} in examples.txt");
        }
    }

    /// Returns the command at `path`, with clap's build step done.
    fn command_at(path: &str) -> Command {
        let mut all = Arguments::command();
        all.build();
        path.split(' ')
            .skip(1)
            .fold(&mut all, |outer, name| {
                outer.find_subcommand_mut(name).expect("it is a leaf")
            })
            .clone()
    }

    /// Returns the options that a line of usage shows as required, outside of brackets and choices.
    fn required(usage: &str) -> Vec<&str> {
        let mut depth = 0;
        usage
            .split_whitespace()
            .filter(|word| {
                let begins_outside = depth == 0;
                let count = |signs: [char; 2]| word.matches(signs).count() as i32;
                depth += count(['[', '<']) - count([']', '>']);
                begins_outside && word.starts_with("--")
            })
            .collect()
    }

    #[test]
    fn every_example_has_what_its_usage_shows_as_required() {
        for path in leaves(&Arguments::command(), "stylus") {
            let usage = command_at(&path).render_usage().to_string();
            for example in examples(&path) {
                let words: Vec<&str> = example.split_whitespace().collect();
                let mut ways = usage.lines().map(required);
                let is_told = ways.any(|way| way.iter().all(|option| words.contains(option)));
                assert!(is_told, "{example}\n{usage}");
            }
        }
    }

    /// Options whose values differ between commands on purpose. The motion of `play` may be the sensors. `upload` needs
    /// no slot for `activate`. `record` makes strokes, and `evaluate` reads them. Trials are a number in a
    /// listening test, and a list in `record`. Parts are results in a folder, or components of textures. `import-hatt`
    /// counts speeds and forces.
    const OF_SEVERAL_KINDS: [&str; 7] = ["motion", "activate", "strokes", "trials", "parts", "speeds", "forces"];

    #[test]
    fn an_option_has_the_same_kind_of_value_and_the_same_choices_in_every_command() {
        let mut known: BTreeMap<String, (String, String)> = BTreeMap::new();
        let mut departures = Vec::new();
        for path in leaves(&Arguments::command(), "stylus") {
            for option in command_at(&path).get_arguments() {
                let is_exempt = |long: &&str| OF_SEVERAL_KINDS.contains(long);
                let Some(long) = option.get_long().filter(|long| !is_exempt(long)) else {
                    continue;
                };
                let values = option.get_possible_values();
                let choices: Vec<&str> = values.iter().map(PossibleValue::get_name).collect();
                let of_value = format!("{:?}", option.get_value_parser().type_id());
                // Numbers of all widths count as one kind.
                let of_value = of_value.trim_end_matches(|c: char| c.is_ascii_digit());
                let kind = format!("{} of {choices:?}", of_value.replace('u', "f"));
                let (of, before) = known
                    .entry(long.to_owned())
                    .or_insert_with(|| (path.clone(), kind.clone()));
                if *before != kind {
                    departures.push(format!("--{long}: {before} of {of}, {kind} of {path}"));
                }
            }
        }
        assert!(departures.is_empty(), "{departures:#?}");
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

    #[test]
    fn every_shell_completes_the_commands_and_their_options() {
        for shell in Shell::value_variants() {
            let script = String::from_utf8(script(*shell, &mut cli::whole())).unwrap();
            for word in ["simulate-rig", "fit-tap", "leave-one-out", "accelerometer-bandwidth"] {
                assert!(script.contains(word), "{shell}: {word}");
            }
        }
    }

    #[test]
    fn a_page_has_its_command_and_what_is_none_is_refused() {
        for (path, word) in [
            ("", "stylus"),
            ("fit", "stylus\\-fit"),
            ("scene check", "stylus\\-scene\\-check"),
        ] {
            let names: Vec<String> = path.split_whitespace().map(str::to_owned).collect();
            let page = String::from_utf8(page(&names, &mut cli::whole()).unwrap()).unwrap();
            assert!(page.contains(".SH SYNOPSIS") && page.contains(word), "{path}: {page}");
        }
        let refused = page(&["fti".to_owned()], &mut cli::whole()).unwrap_err();
        test_helpers::holds(&refused, &["'fti'", "--help"]);
    }
}
