//! Clippy for all code that is built for the target.

use anyhow::Result;

use crate::guest::{self, Processor};
use crate::toolchain::{Toolchain, check_clippy};
use crate::{process, workspace};

/// The packages of the workspace that run on the target.
const PACKAGES: [&str; 5] = [
    "model-format",
    "stylus-kernel",
    "stylus-app",
    "stylus-firmware",
    "kernel-vectors",
];

/// Lints everything that runs on the target; every warning is a failure.
///
/// # Errors
/// There is no toolchain, or there is a warning.
pub fn check_target(toolchain: &Toolchain) -> Result<()> {
    const PROCESSOR: Processor = Processor::CortexM7;
    check_clippy(toolchain)?;
    let target_folder = workspace::target_folder("lint");
    let mut packages = toolchain.cargo("clippy", workspace::root(), &target_folder);
    packages.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
    // The image, with the faults that only its tests have, and what a debugger asks for.
    let mut image = toolchain.cargo("clippy", workspace::root(), &target_folder);
    image.args([
        "--package",
        "stylus-firmware",
        "--features",
        "fault-injection,debug-halt",
    ]);
    // The folder and profile of its build, so that most of that build is used again.
    let target_folder = workspace::target_folder(PROCESSOR.name());
    let mut guest = toolchain.cargo("clippy", &guest::folder(), &target_folder);
    guest.arg("--release");
    for command in [&mut packages, &mut image, &mut guest] {
        command.arg("--quiet");
        command.env("RUSTFLAGS", guest::compiler_flags(PROCESSOR));
        process::run(command.args(["--", "--deny", "warnings"]))?;
    }
    Ok(())
}
