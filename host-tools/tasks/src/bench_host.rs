//! Paired comparisons of what the host's commands take; the work is in `host-tools/benches/host/`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Result;
use crate::{process, workspace};

/// Arguments of `cargo tasks bench-host`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Few and short turns, to see that it runs
    #[arg(long)]
    quick: bool,
    /// Compares whole commands of an earlier build of stylus with this one's; left out without one
    #[arg(long, value_name = "STYLUS")]
    before: Option<PathBuf>,
    /// Python whose NumPy and SciPy fit the same models [default: python3, and left out where it has not both]
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
}

/// Builds the benchmark as it is shipped, and runs it.
///
/// # Errors
/// The build or a comparison fails; its output tells.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut command = Command::new("cargo");
    command.current_dir(workspace::root()).args([
        "bench",
        "--quiet",
        "--locked",
        "--package",
        "host-tools",
        "--bench",
        "host",
        "--",
    ]);
    if arguments.quick {
        command.arg("--quick");
    }
    for (option, file) in [
        ("--before", &arguments.before),
        ("--python", &arguments.python),
    ] {
        if let Some(file) = file {
            command.arg(option).arg(from_anywhere(file));
        }
    }
    process::run(&mut command)
}

/// A path that holds in every folder, because the benchmark runs in the package's. A name that is looked up in PATH
/// stays.
fn from_anywhere(file: &Path) -> PathBuf {
    if file.components().count() > 1 || file.exists() {
        std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
    } else {
        file.to_owned()
    }
}
