//! Paired comparisons of what the host's commands take; the work is in `host-tools/benches/host.rs`.

use std::path::PathBuf;
use std::process::Command;

use crate::error::Result;
use crate::{process, workspace};

/// Arguments of `cargo tasks bench-host`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Few and short turns, to see that it runs
    #[arg(long)]
    quick: bool,
    /// An older build of stylus, whose commands are compared with this one's
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
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
        "--package",
        "host-tools",
        "--bench",
        "host",
        "--",
    ]);
    if arguments.quick {
        command.arg("--quick");
    }
    if let Some(before) = &arguments.before {
        // The benchmark runs in the package's folder.
        let before = std::path::absolute(before).unwrap_or_else(|_| before.clone());
        command.arg("--before").arg(before);
    }
    process::run(&mut command)
}
