//! The `stylus` command: it turns recordings of a surface into a library of texture models, and the library into the
//! samples that the stylus plays.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    // First of all, so that the blocks of every recording that is read later are reused.
    stylus_support::freed_memory::keep();
    cli::run()
}
