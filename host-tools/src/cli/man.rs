//! `stylus man`: a manual page of each command.

use clap::Command;
use host_tools::support::error::{Error, Result};
use host_tools::support::output_folder::OutputFolder;

use super::destination::{self, Destination};
use crate::cli::output::print;

/// The command whose results its folders are.
const COMMAND: &str = "man";

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the pages
    #[arg(long, value_name = "DIR", value_parser = destination::folder(COMMAND))]
    out: Destination,
}

/// Writes the pages of `command`, the whole command line.
pub fn run(arguments: &Arguments, command: Command) -> Result<()> {
    let out = arguments.out.path();
    let pages = OutputFolder::begin(out, COMMAND)?.fill(|folder| {
        let path = folder.path();
        clap_mangen::generate_to(command, path).map_err(Error::io("write", path))?;
        let entries = std::fs::read_dir(path).map_err(Error::io("read", path))?;
        Ok(entries.count())
    })?;
    print(&format!(
        "{pages} pages -> {}; read one with `man {}`",
        out.display(),
        out.join("stylus.1").display()
    ))
}
