//! The image for the STM32H743: its build, its use of memory, the placement of the tick's code, and flashing; and the
//! check that the image has the same bytes wherever it is built.

mod dfu;
mod memory;
mod placement;
mod segments;
mod update_file;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use stylus_board::{ALL, Board};

use crate::house::tree::Tree;
use crate::process::{self, Progress};
use crate::toolchain::Toolchain;
use crate::workspace::{self, Folders, TARGET};

pub use memory::{Memory, Use};
pub use placement::check as check_placement;
pub use update_file::{Arguments as UpdateArguments, make_keys, write as write_update};

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

    fn file_name(self, board: &Board) -> String {
        let variant = match self {
            Self::Product => "",
            Self::FaultInjection => "-faults",
            Self::DebugHalt => "-debug-halt",
        };
        format!("stylus-firmware{}{variant}.elf", suffix(board))
    }
}

/// What the names of a board's files have behind their first words: nothing for the first board.
pub fn suffix(board: &Board) -> String {
    if board.name == ALL[0].name {
        return String::new();
    }
    format!("-{}", board.name.to_lowercase())
}

/// Builds `image` for `board` and returns its file. Checks that the tick's code reads no flash, that flashing writes
/// only the bootloader, the image and the records' last pages, and that the product leaves free space in bootloader,
/// flash and ITCM. A second file for the part's built-in loader is written next to it, with the extension dfu.
///
/// # Errors
/// There is no toolchain, the build fails, the tick leads to flash, a segment is in another region, or the product is
/// too large.
pub fn build(toolchain: &Toolchain, board: &Board, image: Image) -> Result<PathBuf> {
    build_saying(toolchain, board, image, Progress::Quiet)
}

/// Builds like [`build`]. `progress` decides how much of the build is shown.
pub fn build_saying(toolchain: &Toolchain, board: &Board, image: Image, progress: Progress) -> Result<PathBuf> {
    let kept = build_in(toolchain, board, image, &Folders::here(FOLDER), progress)?;
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

/// Returns cargo for a package that is flashed on `board`, with these `features` and the flags that all such packages
/// share. The last feature is a crate's for each part.
fn cargo(
    toolchain: &Toolchain,
    subcommand: &str,
    package: &str,
    features: &str,
    board: &Board,
    folders: &Folders,
) -> Command {
    let mut cargo = toolchain.cargo(subcommand, &folders.sources, &folders.target);
    cargo.args(["--package", package, "--profile", PROFILE, "--no-default-features"]);
    cargo.args(["--features", &format!("{features}/{}", board.part)]);
    cargo.env("STYLUS_BOARD", board.name.to_lowercase());
    cargo.env("CARGO_HOME", &folders.cargo_home);
    cargo.env(
        "CARGO_ENCODED_RUSTFLAGS",
        folders.compiler_flags(&["-C", "target-cpu=cortex-m7"]),
    );
    cargo
}

/// Returns cargo for the bootloader.
pub(crate) fn bootloader(toolchain: &Toolchain, subcommand: &str, board: &Board, folders: &Folders) -> Command {
    cargo(
        toolchain,
        subcommand,
        "stylus-boot",
        "image,stm32-metapac",
        board,
        folders,
    )
}

/// Builds the bootloader, and returns the file that contains its bytes.
fn build_bootloader(toolchain: &Toolchain, board: &Board, folders: &Folders, progress: Progress) -> Result<PathBuf> {
    process::run(bootloader(toolchain, "build", board, folders).args(progress.argument()))?;
    let built = folders.target.join(TARGET).join("firmware/stylus-boot");
    let bytes = read(&process::built(built)?)?;
    let kept = folders.target.join(format!("stylus-boot{}.bin", suffix(board)));
    fs::write(&kept, segments::flashed(&bytes, "BOOTLOADER")?)?;
    Ok(kept)
}

fn build_in(
    toolchain: &Toolchain,
    board: &Board,
    image: Image,
    folders: &Folders,
    progress: Progress,
) -> Result<PathBuf> {
    let bootloader = build_bootloader(toolchain, board, folders, progress)?;
    let features = format!("{},embassy-stm32", image.features());
    let mut cargo = cargo(toolchain, "build", "stylus-image", &features, board, folders);
    cargo.args(progress.argument());
    cargo.env("STYLUS_BOOTLOADER", bootloader);
    // Without this variable, defmt drops all messages but errors.
    if std::env::var_os("DEFMT_LOG").is_none() {
        cargo.env("DEFMT_LOG", "info");
    }
    process::run(&mut cargo)?;
    let built = folders.target.join(TARGET).join("firmware/stylus-firmware");
    // All variants are built under one name, so each is copied to its own name.
    let kept = folders.target.join(image.file_name(board));
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
const PROBE_RS: [&str; 4] = ["run", "--no-catch-hardfault", "--no-catch-reset", "--chip"];

/// Returns the program that flashes images.
pub fn probe_rs() -> Result<PathBuf> {
    process::find("probe-rs", "https://probe.rs/docs/getting-started/installation")
}

/// Flashes the image in `file` to the board on the probe and starts it, without staying attached.
pub fn download(file: &Path, board: &Board) -> Result<()> {
    let program = probe_rs()?;
    let probe = |subcommand: &str| {
        let mut command = Command::new(&program);
        command.args([subcommand, "--chip", board.probe]);
        command
    };
    process::run(probe("download").arg(file))?;
    process::run(&mut probe("reset"))
}

/// Flashes the image in `file` to the board on the probe, and shows its log until Ctrl-C.
pub fn flash(file: &Path, board: &Board) -> Result<()> {
    let mut command = Command::new(probe_rs()?);
    command.args(PROBE_RS).arg(board.probe).arg(file);
    process::run(&mut command)
}

/// Builds the image here, and again from a copy of the sources in another folder, with another output folder and, on
/// Unix, another name for the folder of cargo's own files. Returns the image's length, bytes.
pub fn check_reproducible(toolchain: &Toolchain, board: &Board) -> Result<usize> {
    let first = read(&build(toolchain, board, Image::Product)?)?;
    let here = Folders::here(FOLDER);
    if let Some(name) = here.named_in(&first) {
        bail!("the image names {name}");
    }
    let elsewhere = workspace::target_folder("elsewhere");
    // Names of other lengths and with spaces, because a path that reaches the image would change its size.
    let mut folders = Folders {
        sources: elsewhere.join("of-another/the sources"),
        target: elsewhere.join("outputs"),
        ..here
    };
    if folders.sources.exists() {
        fs::remove_dir_all(&folders.sources)?;
    }
    for path in Tree::read(workspace::root())?.paths() {
        let to = folders.sources.join(path);
        fs::create_dir_all(to.parent().unwrap_or(&to))?;
        fs::copy(workspace::root().join(path), &to).with_context(|| to.display().to_string())?;
    }
    #[cfg(unix)]
    {
        let link = elsewhere.join("home of cargo");
        // A link that an earlier check left may lead nowhere.
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink(&folders.cargo_home, &link)?;
        folders.cargo_home = link;
    }
    let second = build_in(toolchain, board, Image::Product, &folders, Progress::Quiet)?;
    let second = read(&second)?;
    if first != second {
        let at = first
            .iter()
            .zip(&second)
            .take_while(|(one, other)| one == other)
            .count();
        bail!(
            "two builds in two folders differ from byte {at} of the file on: see --remap-path-prefix in \
             host-tools/tasks/src/workspace.rs"
        );
    }
    Ok(first.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace;

    #[test]
    fn cargo_run_flashes_as_the_task_does() {
        let path = workspace::root().join(".cargo/config.toml");
        let config = fs::read_to_string(path).expect("it is there");
        let runner = format!("runner = \"probe-rs {} {}\"", PROBE_RS.join(" "), ALL[0].probe);
        assert!(config.contains(&runner), "{runner}");
    }
}
