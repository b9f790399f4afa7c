//! `stylus completions` and `stylus man`: what a system has of a command beside the command itself.

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use std::path::Path;
use stylus_support::{Error, Result};

use super::output::print_exactly;

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
    use clap::ValueEnum;

    use super::*;
    use crate::cli::whole;

    #[test]
    fn every_shell_completes_the_commands_and_their_options() {
        for shell in Shell::value_variants() {
            let script = String::from_utf8(script(*shell, &mut whole())).unwrap();
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
            let page = String::from_utf8(page(&names, &mut whole()).unwrap()).unwrap();
            assert!(page.contains(".SH SYNOPSIS") && page.contains(word), "{path}: {page}");
        }
        let refused = page(&["fti".to_owned()], &mut whole()).unwrap_err();
        test_helpers::holds(&refused, &["'fti'", "--help"]);
    }
}
