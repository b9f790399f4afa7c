//! The wheel of the Python package, which needs no compiler where it is installed.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use super::Build;
use crate::{process, toolchain, workspace};

/// The program that builds wheels.
///
/// # Errors
/// maturin is not installed.
pub fn maturin() -> Result<PathBuf> {
    process::find("maturin", "`pip install maturin`")
}

/// Builds the wheel for this system, for each Python from 3.9 on.
///
/// # Errors
/// maturin is not installed, or fails.
pub fn build(build: &Build) -> Result<()> {
    let profile = if build.is_dev { "dev" } else { "release" };
    let mut program = Command::new(maturin()?);
    toolchain::without_inherited(&mut program);
    program
        .current_dir(workspace::root())
        .args(["build", "--locked", "--profile", profile])
        .args(["--manifest-path", "host-tools/python/Cargo.toml", "--out"])
        .arg(&build.out)
        .env("SOURCE_DATE_EPOCH", &build.epoch);
    if build.is_dev {
        program.env("CARGO_TARGET_DIR", workspace::host_target_folder());
    } else {
        // In a folder of its own, because other flags would make cargo build everything there again.
        program.env("CARGO_TARGET_DIR", &build.folders.target);
        program.env("CARGO_ENCODED_RUSTFLAGS", build.folders.compiler_flags(&[]));
    }
    process::run(&mut program)
}
