//! The virtual stylus: `tests/virtual-stylus`, a workspace of its own.
//!
//! Its emulator declares a newer compiler than the product's, and builds and runs with the product's all the same.
//! Cargo needs `--ignore-rust-version` for that.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::{Error, Result};
use crate::firmware::{self, Image};
use crate::target::TARGET;
use crate::toolchain::Toolchain;
use crate::{costs, process, tables, workspace};

fn folder() -> PathBuf {
    workspace::root().join("tests/virtual-stylus")
}

/// Cargo for the host, in the virtual stylus's workspace. It shares the folder of the product's own builds, so that
/// common dependencies are built once.
fn cargo(subcommand: &str) -> Command {
    let mut cargo = Command::new("cargo");
    cargo.current_dir(folder());
    cargo.env("CARGO_TARGET_DIR", workspace::host_target_folder());
    cargo.args([subcommand, "--quiet", "--locked", "--ignore-rust-version"]);
    cargo
}

/// Runs the product's image by hand, with the virtual stylus's own `arguments`.
///
/// # Errors
/// A build or the run fails.
pub fn run(toolchain: &Toolchain, arguments: &[OsString]) -> Result<()> {
    let image = firmware::build(toolchain, Image::Product)?;
    let mut run = cargo("run");
    run.args(["--bin", "virtual-stylus", "--", "--image"])
        .arg(image);
    process::run(run.args(arguments))
}

/// Builds the images and runs all tests on the virtual stylus, with `long` the long ones too. `arguments` go to the
/// tests. Then compares the page's table of memory with the image.
///
/// # Errors
/// A build or a test fails, or the page's table is not of this image.
pub fn test(toolchain: &Toolchain, long: bool, arguments: &[OsString]) -> Result<()> {
    let product = firmware::build(toolchain, Image::Product)?;
    let memory = firmware::memory(&product)?;
    print!("{memory}");
    let mut test = tests(toolchain, product)?;
    if long {
        test.env("STYLUS_LONG", "1");
    }
    process::run(test.arg("--").args(arguments))?;
    let compiler = costs::compiler(toolchain)?;
    let made = tables::memory::table_of(&memory, &compiler);
    if !tables::check_made(tables::memory::NAME, &made, &compiler)? {
        println!("rustc {compiler} is not the one of the page's table of memory: not compared");
    }
    Ok(())
}

/// Builds the virtual stylus's program, and returns it.
///
/// # Errors
/// The build fails.
pub fn build() -> Result<PathBuf> {
    process::run(cargo("build").args(["--bin", "virtual-stylus"]))?;
    let program = workspace::host_target_folder().join("debug/virtual-stylus");
    if program.is_file() {
        Ok(program)
    } else {
        Err(Error::NoImage(program))
    }
}

/// Runs the tests that count ticks so that they write the page's table.
///
/// # Errors
/// A build or a test fails.
pub fn write_ticks(toolchain: &Toolchain) -> Result<()> {
    let product = firmware::build(toolchain, Image::Product)?;
    let mut test = tests(toolchain, product)?;
    test.env("STYLUS_WRITE_TABLES", "1");
    process::run(test.args(["--test", "image", "--", "ticks::"]))
}

/// The command that tests the virtual stylus with the product's image in the file `product`.
fn tests(toolchain: &Toolchain, product: PathBuf) -> Result<Command> {
    let mut test = cargo("test");
    test.env("STYLUS_IMAGE", product);
    test.env("STYLUS_COMPILER", costs::compiler(toolchain)?);
    test.env(
        "STYLUS_FAULT_IMAGE",
        firmware::build(toolchain, Image::FaultInjection)?,
    );
    test.env("VIRTUAL_STYLUS_PROBE_IMAGE", build_probe(toolchain)?);
    Ok(test)
}

/// Lints the virtual stylus; every warning is a failure.
///
/// # Errors
/// There is a warning, or the build fails.
pub fn lint() -> Result<()> {
    process::run(cargo("clippy").args(["--all-targets", "--", "--deny", "warnings"]))
}

/// Builds the image that compares the models with the manual, and returns it.
fn build_probe(toolchain: &Toolchain) -> Result<PathBuf> {
    let target_folder = workspace::target_folder("probe-image");
    let mut cargo = toolchain.cargo("build", &folder().join("probe-image"), &target_folder);
    process::run(cargo.args(["--release", "--quiet", "--locked"]))?;
    let image = target_folder
        .join(Path::new(TARGET))
        .join("release/probe-image");
    if image.is_file() {
        Ok(image)
    } else {
        Err(Error::NoImage(image))
    }
}
