//! Clippy for all code that is built for the target.

use anyhow::Result;

use crate::guest::{self, Processor};
use crate::toolchain::{Toolchain, check_clippy};
use crate::workspace::Folders;
use crate::{firmware, process, workspace};

/// The packages of the workspace that run on the target.
const PACKAGES: [&str; 7] = [
    "model-format",
    "stylus-kernel",
    "stylus-app",
    "stylus-boot",
    "stylus-realtime",
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
    // The folder and profile of the image's build, so that its build scripts and macros are built once.
    let target_folder = workspace::target_folder(firmware::FOLDER);
    let mut packages = toolchain.cargo("clippy", workspace::root(), &target_folder);
    packages.args(["--profile", firmware::PROFILE]);
    packages.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
    // The image, with the faults that only its tests have, and what a debugger asks for.
    let mut image = toolchain.cargo("clippy", workspace::root(), &target_folder);
    image.args([
        "--profile",
        firmware::PROFILE,
        "--package",
        "stylus-image",
        "--features",
        "fault-injection,debug-halt",
    ]);
    let target_folder = workspace::target_folder(PROCESSOR.name());
    let mut guest = toolchain.cargo("clippy", &guest::folder(), &target_folder);
    guest.arg("--release");
    let mut bootloader =
        firmware::bootloader(toolchain, "clippy", &Folders::here(firmware::FOLDER));
    for command in [&mut packages, &mut image, &mut bootloader, &mut guest] {
        command.arg("--quiet");
        command.env("RUSTFLAGS", guest::compiler_flags(PROCESSOR));
        process::run(command.args(["--", "--deny", "warnings"]))?;
    }
    Ok(())
}
