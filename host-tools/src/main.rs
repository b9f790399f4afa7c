//! The `stylus` command: from recordings of a surface to a library of texture models, and to the samples that the
//! stylus plays.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    host_tools::support::freed_memory::keep();
    cli::run()
}
