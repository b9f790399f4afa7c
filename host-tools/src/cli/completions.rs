//! `stylus completions`: scripts by which a shell completes commands, options and their values.

use clap::Command;
use clap_complete::{Shell, generate};
use host_tools::support::error::Result;

use crate::cli::output::print_exactly;

#[derive(clap::Args)]
pub struct Arguments {
    /// Shell whose script is printed
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the script for `command`, the whole command line.
pub fn run(arguments: &Arguments, command: Command) -> Result<()> {
    let mut command = shown(command);
    let mut script = Vec::new();
    generate(arguments.shell, &mut command, "stylus", &mut script);
    print_exactly(&script)
}

/// `command` with the commands that its help lists.
fn shown(command: Command) -> Command {
    let inner: Vec<Command> = (command.get_subcommands())
        .filter(|inner| !inner.is_hide_set())
        .map(|inner| shown(inner.clone()))
        .collect();
    if inner.is_empty() {
        return command;
    }
    // A command cannot lose one of its own, so it is made again of what else it has.
    let mut again = Command::new(command.get_name().to_owned()).args(command.get_arguments());
    if let Some(about) = command.get_about() {
        again = again.about(about.clone());
    }
    if let Some(version) = command.get_version() {
        again = again.version(version.to_owned());
    }
    again.subcommands(inner)
}
