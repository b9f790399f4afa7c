//! The wheel of the Python package, so that an installation needs no compiler.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use super::Build;
use crate::{process, toolchain, workspace};

/// Returns the program that builds wheels.
pub fn maturin() -> Result<PathBuf> {
    process::find("maturin", "`pip install maturin`")
}

/// Builds the wheel for this system. It fits every Python from 3.9 on.
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
        // A separate folder, because other flags would make cargo rebuild everything in the common one.
        program.env("CARGO_TARGET_DIR", &build.folders.target);
        program.env("CARGO_ENCODED_RUSTFLAGS", build.folders.compiler_flags(&[]));
    }
    process::run(&mut program)
}
