//! Runs Clippy on the code that is built for the target, except the probe image of `host-tools/virtual-stylus`.

use anyhow::Result;
use stylus_board::ALL;

use crate::qemu::{self, Processor};
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

/// Returns arguments by which Clippy and the compiler treat warnings. With the compiler that `rust-version` names, each
/// warning is a failure. Another compiler may have lints that nobody here has seen, so it only warns, and a new release
/// of Rust breaks no build.
///
/// `compiler` is the compiler's name and version, such as `rustc 1.95.0 (59807616e 2026-04-14)`.
pub fn severity(compiler: &str) -> &'static [&'static str] {
    let version = compiler.strip_prefix("rustc ").unwrap_or(compiler);
    let own = version
        .strip_prefix(env!("CARGO_PKG_RUST_VERSION"))
        .is_some_and(|rest| rest.starts_with('.'));
    if own { &["--deny", "warnings"] } else { &[] }
}

/// Lints the packages, the image, the bootloader and the guest of QEMU. A warning is a failure if [`severity`] says so.
pub fn check_target(toolchain: &Toolchain) -> Result<()> {
    const PROCESSOR: Processor = Processor::CortexM7;
    check_clippy(toolchain)?;
    let compiler = toolchain.compiler_version()?;
    // The folder and profile are those of the image's build, so that build scripts and macros are built only once.
    let target_folder = workspace::target_folder(firmware::FOLDER);
    let mut packages = toolchain.cargo("clippy", workspace::root(), &target_folder);
    packages.args(["--profile", firmware::PROFILE]);
    packages.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
    // The image, with the faults that only its tests use, and with the debugger's variant.
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
    let mut guest = toolchain.cargo("clippy", &qemu::guest_folder(), &target_folder);
    guest.arg("--release");
    let mut bootloader = firmware::bootloader(toolchain, "clippy", &ALL[0], &Folders::here(firmware::FOLDER));
    for command in [&mut packages, &mut image, &mut bootloader, &mut guest] {
        command.arg("--quiet");
        command.env("RUSTFLAGS", qemu::guest_flags(PROCESSOR));
        process::run(command.arg("--").args(severity(&compiler)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_are_failures_with_the_named_compiler_alone() {
        let named = env!("CARGO_PKG_RUST_VERSION");
        assert_eq!(
            severity(&format!("rustc {named}.2 (59807616e 2026-04-14)")),
            ["--deny", "warnings"]
        );
        assert!(severity(&format!("rustc {named}1.0 (59807616e 2026-04-14)")).is_empty());
        assert!(severity("rustc 2.0.0 (59807616e 2030-04-14)").is_empty());
    }
}
