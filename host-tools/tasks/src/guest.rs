//! The image that plays the test vectors: `tests/qemu/guest`.

use std::path::PathBuf;

use anyhow::Result;

use crate::toolchain::Toolchain;
use crate::workspace::TARGET;
use crate::{process, workspace};

/// A processor for which the kernel is built. QEMU emulates each on one of Arm's boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// The processor of a small stylus.
    CortexM4,
    /// The processor of the product's board.
    CortexM7,
}

impl Processor {
    /// All processors.
    pub const ALL: [Self; 2] = [Self::CortexM4, Self::CortexM7];

    /// Returns the compiler's name of the processor.
    pub const fn name(self) -> &'static str {
        match self {
            Self::CortexM4 => "cortex-m4",
            Self::CortexM7 => "cortex-m7",
        }
    }

    /// Returns QEMU's name of the board.
    pub const fn machine(self) -> &'static str {
        match self {
            Self::CortexM4 => "mps2-an386",
            Self::CortexM7 => "mps2-an500",
        }
    }
}

/// Returns the folder of the guest's workspace.
pub fn folder() -> PathBuf {
    workspace::root().join("tests/qemu/guest")
}

/// Returns flags for the compiler: the processor, cortex-m-rt's linker script, and segments without padding to pages.
pub fn compiler_flags(processor: Processor) -> String {
    let name = processor.name();
    format!("-C target-cpu={name} -C link-arg=-Tlink.x -C link-arg=--nmagic")
}

/// Builds the guest, and returns its image.
pub fn build(toolchain: &Toolchain, processor: Processor) -> Result<PathBuf> {
    let target_folder = workspace::target_folder(processor.name());
    let mut cargo = toolchain.cargo("build", &folder(), &target_folder);
    cargo.args(["--release", "--quiet"]);
    cargo.env("RUSTFLAGS", compiler_flags(processor));
    process::run(&mut cargo)?;
    process::built(target_folder.join(TARGET).join("release/kernel-guest"))
}
