//! The virtual stylus: `host-tools/virtual-stylus`, a separate workspace.
//!
//! The emulator's manifest requires a newer compiler than the product's, but the emulator builds and runs with the
//! product's. Cargo needs `--ignore-rust-version` for that.

use std::ffi::OsString;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::process::Command;
use std::thread;

use anyhow::Result;
use stylus_board::{ALL, Board};

use crate::firmware::{self, Image};
use crate::process::Progress;
use crate::toolchain::{self, Toolchain};
use crate::workspace::TARGET;
use crate::{lint, process, tables, workspace};

/// Duration of the first build of image and emulator, as stated in the README.
const FIRST_BUILD: &str = "four minutes";

fn folder() -> PathBuf {
    workspace::root().join("host-tools/virtual-stylus")
}

/// Returns the folder of the virtual stylus's builds. It is not the folder of the product's own builds, because a build
/// would wait there for the end of theirs.
fn target_folder() -> PathBuf {
    workspace::target_folder("virtual-stylus")
}

/// Returns cargo for the host, in the virtual stylus's workspace.
fn cargo(subcommand: &str, progress: Progress) -> Command {
    let mut cargo = Command::new("cargo");
    cargo.current_dir(folder());
    cargo.env("CARGO_TARGET_DIR", target_folder());
    cargo.arg(subcommand).args(progress.argument());
    cargo.args(["--locked", "--ignore-rust-version"]);
    cargo
}

/// Runs the product's image for `board` for interactive use, with the virtual stylus's own `arguments`, and returns its
/// exit code. Image and emulator are built at the same time, because the end of either build keeps only one core busy.
/// The progress of the longer build, the emulator's, is shown.
pub fn run(toolchain: &Toolchain, board: &Board, arguments: &[OsString]) -> Result<u8> {
    eprintln!(
        "building the emulator, and beside it the image for the STM32H743: {FIRST_BUILD} the first time, on two idle \
         cores"
    );
    let (image, program) = thread::scope(|scope| {
        let image = scope.spawn(|| firmware::build(toolchain, board, Image::Product));
        let program = build(Progress::Shown);
        let image = image.join().unwrap_or_else(|panic| resume_unwind(panic));
        (image, program)
    });
    let (image, program) = (image?, program?);
    let mut run = Command::new(program);
    run.args(["--board", board.name]).arg("--image").arg(image);
    process::become_like(run.args(arguments))
}

/// Builds the images and runs all tests on the virtual stylus, including the long ones if `long`. The tests receive
/// `arguments`. Then compares the page's table of memory with the image.
///
/// # Errors
/// A build or a test fails, or the page's table does not describe this image.
pub fn test(toolchain: &Toolchain, long: bool, arguments: &[OsString]) -> Result<()> {
    let product = firmware::build(toolchain, &ALL[0], Image::Product)?;
    let memory = firmware::memory(&product)?;
    print!("{memory}");
    let mut test = tests(toolchain, product)?;
    if long {
        test.env("STYLUS_LONG", "1");
    }
    process::run(test.arg("--").args(arguments))?;
    let compiler = toolchain.compiler()?;
    let made = tables::memory(&memory, &compiler);
    if !tables::check_made(tables::MEMORY, &made, &compiler)? {
        println!("rustc {compiler} is not the one of the page's table of memory: not compared");
    }
    Ok(())
}

/// Builds the virtual stylus's program, and returns its path. `progress` sets how much is printed.
pub fn build(progress: Progress) -> Result<PathBuf> {
    built(cargo("build", progress).args(["--bin", "virtual-stylus"]))
}

/// Builds like [`build`], but with the features that the tests enable in common dependencies, so that after a run of
/// the tests nothing is built again.
pub fn build_as_tested() -> Result<PathBuf> {
    built(cargo("test", Progress::Quiet).args(["--no-run", "--test", "models"]))
}

fn built(cargo: &mut Command) -> Result<PathBuf> {
    process::run(cargo)?;
    process::built(target_folder().join("debug/virtual-stylus"))
}

/// Runs the tests that count ticks, such that they write the page's table.
pub fn write_ticks(toolchain: &Toolchain) -> Result<()> {
    let product = firmware::build(toolchain, &ALL[0], Image::Product)?;
    let mut test = tests(toolchain, product)?;
    test.env("STYLUS_WRITE_TABLES", "1");
    process::run(test.args(["--test", "image", "--", "ticks::"]))
}

/// Runs only the test of endurance, with these environment variables.
pub fn soak(toolchain: &Toolchain, variables: [(&str, u64); 2]) -> Result<()> {
    let product = firmware::build(toolchain, &ALL[0], Image::Product)?;
    let mut test = tests(toolchain, product)?;
    test.envs(variables.map(|(name, value)| (name, value.to_string())));
    process::run(test.args(["--test", "image", "--", "--ignored", "--nocapture", "soak::"]))
}

/// Returns the command that tests the virtual stylus with the product's image in the file `product`, which is for the
/// first board, and with the product's images for all others.
fn tests(toolchain: &Toolchain, product: PathBuf) -> Result<Command> {
    let mut test = cargo("test", Progress::Quiet);
    test.env("STYLUS_IMAGE", product);
    test.env("STYLUS_COMPILER", toolchain.compiler()?);
    test.env(
        "STYLUS_FAULT_IMAGE",
        firmware::build(toolchain, &ALL[0], Image::FaultInjection)?,
    );
    for board in &ALL[1..] {
        let name = format!("STYLUS_IMAGE_{}", board.name);
        test.env(name, firmware::build(toolchain, board, Image::Product)?);
    }
    test.env("VIRTUAL_STYLUS_PROBE_IMAGE", build_probe(toolchain)?);
    Ok(test)
}

/// Lints the virtual stylus. A warning is a failure if [`lint::severity`] says so.
pub fn lint() -> Result<()> {
    let mut clippy = cargo("clippy", Progress::Quiet);
    let severity = lint::severity(&toolchain::version_in_use()?);
    process::run(clippy.args(["--all-targets", "--"]).args(severity))
}

/// Builds the image that compares the models of the hardware with the manual, and returns its file.
fn build_probe(toolchain: &Toolchain) -> Result<PathBuf> {
    let target_folder = workspace::target_folder("probe-image");
    let mut cargo = toolchain.cargo("build", &folder().join("probe-image"), &target_folder);
    process::run(cargo.args(["--release", "--quiet"]))?;
    process::built(target_folder.join(TARGET).join("release/probe-image"))
}
