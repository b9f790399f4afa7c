//! The image for the STM32H743: its build, its use of memory, the placement of the tick's code, and flashing.

mod dfu;
mod memory;
mod placement;
mod reproducible;
mod segments;
mod update_file;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::process::{self, Progress};
use crate::toolchain::Toolchain;
use crate::workspace::{Folders, TARGET};

pub use memory::{Memory, Use};
pub use placement::check as check_placement;
pub use reproducible::check as check_reproducible;
pub use update_file::{Arguments as UpdateArguments, make_keys, write as write_update};

/// The part's name for probe-rs.
const CHIP: &str = "STM32H743ZITx";

/// Name of the folder of the firmware's builds.
pub(crate) const FOLDER: &str = "firmware";

/// The profile in the workspace's manifest.
pub(crate) const PROFILE: &str = "firmware";

/// A variant of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// The image of the release.
    Product,
    /// The image with faults on request, for tests of the firmware's reaction to faults.
    FaultInjection,
    /// The image whose watchdog stops while a debugger halts the core.
    DebugHalt,
}

impl Image {
    /// Cargo features that select this variant.
    const fn features(self) -> &'static str {
        match self {
            Self::Product => "image",
            Self::FaultInjection => "fault-injection",
            Self::DebugHalt => "debug-halt",
        }
    }

    const fn file_name(self) -> &'static str {
        match self {
            Self::Product => "stylus-firmware.elf",
            Self::FaultInjection => "stylus-firmware-faults.elf",
            Self::DebugHalt => "stylus-firmware-debug-halt.elf",
        }
    }
}

/// Builds `image` and returns its file. Checks that the tick's code reads no flash, that flashing writes only the
/// bootloader, the image and the records' last pages, and that the product leaves free space in bootloader, flash and
/// ITCM. A second file for the part's built-in loader is written next to it, with the extension dfu.
///
/// # Errors
/// There is no toolchain, the build fails, the tick leads to flash, a segment is in another region, or the product is
/// too large.
pub fn build(toolchain: &Toolchain, image: Image) -> Result<PathBuf> {
    build_saying(toolchain, image, Progress::Quiet)
}

/// Builds like [`build`]. `progress` decides how much of the build is shown.
pub fn build_saying(toolchain: &Toolchain, image: Image, progress: Progress) -> Result<PathBuf> {
    let kept = build_in(toolchain, image, &Folders::here(FOLDER), progress)?;
    let bytes = read(&kept)?;
    check_placement(&bytes)?;
    let dfu = kept.with_extension("dfu");
    fs::write(&dfu, dfu::file(&segments::all_pieces(&bytes)?)).with_context(|| dfu.display().to_string())?;
    // The other variants have more code, for tests and debuggers, and may take the room that the product leaves.
    if image == Image::Product {
        Memory::of(&bytes)?.check_limits()?;
    }
    Ok(kept)
}

/// Returns cargo for a package that is flashed, with the flags that all such packages share.
fn cargo(toolchain: &Toolchain, subcommand: &str, package: &str, folders: &Folders) -> Command {
    let mut cargo = toolchain.cargo(subcommand, &folders.sources, &folders.target);
    cargo.args(["--package", package, "--profile", PROFILE]);
    cargo.env("CARGO_HOME", &folders.cargo_home);
    cargo.env(
        "CARGO_ENCODED_RUSTFLAGS",
        folders.compiler_flags(&["-C", "target-cpu=cortex-m7"]),
    );
    cargo
}

/// Returns cargo for the bootloader.
pub(crate) fn bootloader(toolchain: &Toolchain, subcommand: &str, folders: &Folders) -> Command {
    let mut cargo = cargo(toolchain, subcommand, "stylus-boot", folders);
    cargo.args(["--features", "image"]);
    cargo
}

/// Builds the bootloader, and returns the file that contains its bytes.
fn build_bootloader(toolchain: &Toolchain, folders: &Folders, progress: Progress) -> Result<PathBuf> {
    process::run(bootloader(toolchain, "build", folders).args(progress.argument()))?;
    let built = folders.target.join(TARGET).join("firmware/stylus-boot");
    let bytes = read(&process::built(built)?)?;
    let kept = folders.target.join("stylus-boot.bin");
    fs::write(&kept, segments::flashed(&bytes, "BOOTLOADER")?)?;
    Ok(kept)
}

fn build_in(toolchain: &Toolchain, image: Image, folders: &Folders, progress: Progress) -> Result<PathBuf> {
    let bootloader = build_bootloader(toolchain, folders, progress)?;
    let mut cargo = cargo(toolchain, "build", "stylus-image", folders);
    cargo.args(progress.argument());
    cargo.args(["--features", image.features()]);
    cargo.env("STYLUS_BOOTLOADER", bootloader);
    // Without this variable, defmt drops all messages but errors.
    if std::env::var_os("DEFMT_LOG").is_none() {
        cargo.env("DEFMT_LOG", "info");
    }
    process::run(&mut cargo)?;
    let built = folders.target.join(TARGET).join("firmware/stylus-firmware");
    // All variants are built under one name, so each is copied to its own name.
    let kept = folders.target.join(image.file_name());
    fs::copy(process::built(built)?, &kept)?;
    Ok(kept)
}

/// Returns the use of each memory by the image in `file`.
pub fn memory(file: &Path) -> Result<Memory> {
    Memory::of(&read(file)?)
}

fn read(file: &Path) -> Result<Vec<u8>> {
    fs::read(file).with_context(|| file.display().to_string())
}

/// Arguments of probe-rs. By default it halts the core at a HardFault and at a reset, before the image's handlers can
/// put the output to mid-scale. Therefore both catches are switched off.
const PROBE_RS: [&str; 5] = ["run", "--no-catch-hardfault", "--no-catch-reset", "--chip", CHIP];

/// Returns the program that flashes images.
pub fn probe_rs() -> Result<PathBuf> {
    process::find("probe-rs", "https://probe.rs/docs/getting-started/installation")
}

/// Flashes the image in `file` to the board on the probe and starts it, without staying attached.
pub fn download(file: &Path) -> Result<()> {
    let program = probe_rs()?;
    let probe = |subcommand: &str| {
        let mut command = Command::new(&program);
        command.args([subcommand, "--chip", CHIP]);
        command
    };
    process::run(probe("download").arg(file))?;
    process::run(&mut probe("reset"))
}

/// Flashes the image in `file` to the board on the probe, and shows its log until Ctrl-C.
pub fn flash(file: &Path) -> Result<()> {
    let mut command = Command::new(probe_rs()?);
    command.args(PROBE_RS).arg(file);
    process::run(&mut command)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace;

    #[test]
    fn cargo_run_flashes_as_the_task_does() {
        let path = workspace::root().join(".cargo/config.toml");
        let config = fs::read_to_string(path).expect("it is there");
        let runner = format!("runner = \"probe-rs {}\"", PROBE_RS.join(" "));
        assert!(config.contains(&runner), "{runner}");
    }
}
