//! A Rust toolchain that builds for the microcontroller's core, or for pages.
//!
//! On most machines it is rustup's, with the targets that `rust-toolchain.toml` names. Where rustup cannot install a
//! target, Debian's own toolchain is used. It is either installed, or unpacked by `tests/run` into the folder of
//! builds. It lacks the targets too, and builds the library from its source.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail};

use crate::workspace::TARGET;
use crate::{process, workspace};

/// Packages of Debian 12 that build for these targets.
const DEBIAN_PACKAGES: &str = "rustc-web cargo-web rust-web-src rust-web-llvm rust-web-clippy lld-22";

/// Returns the folder with the programs of Debian's toolchain: the unpacked one if there is one, else the installed
/// one.
fn debian_folder() -> PathBuf {
    let unpacked = workspace::tools_folder().join("debian-rust/programs");
    if unpacked.is_dir() {
        unpacked
    } else {
        PathBuf::from("/usr/bin")
    }
}

/// A toolchain that builds for a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Toolchain {
    /// The toolchain in use, which has the target.
    Installed {
        /// Folder of the toolchain.
        sysroot: PathBuf,
    },
    /// Debian's toolchain, which builds the library from source.
    Debian,
}

impl Toolchain {
    /// Returns the first toolchain found that builds for the microcontroller's core.
    pub fn find() -> Result<Self> {
        Self::that_builds_for(TARGET)
    }

    /// Returns the first toolchain found that builds for `target`.
    pub fn that_builds_for(target: &str) -> Result<Self> {
        if let Some(sysroot) = sysroot(Path::new("rustc"))
            && sysroot.join("lib/rustlib").join(target).join("lib").is_dir()
        {
            return Ok(Self::Installed { sysroot });
        }
        let debian = |program: &str| debian_folder().join(program);
        let source =
            sysroot(&debian("rustc")).is_some_and(|sysroot| sysroot.join("lib/rustlib/src/rust/library/core").is_dir());
        if source && debian("cargo").is_file() && debian("rust-lld").is_file() {
            Ok(Self::Debian)
        } else {
            bail!(
                "no Rust toolchain here builds for {target}; install it: `rustup target add {target}`, or, where \
                 rustup has no such target, on Debian 12 `tests/run` (without root), or as root `apt-get install \
                 {DEBIAN_PACKAGES}`"
            )
        }
    }

    /// Returns the compiler's own name and version, such as `rustc 1.95.0 (59807616e 2026-04-14)`.
    pub fn compiler_version(&self) -> Result<String> {
        match self {
            Self::Installed { .. } => version_of(Path::new("rustc")),
            Self::Debian => version_of(&debian_folder().join("rustc")),
        }
    }

    /// Returns the version of the compiler, without its name.
    pub fn compiler(&self) -> Result<String> {
        let version = self.compiler_version()?;
        Ok(version.strip_prefix("rustc ").unwrap_or(&version).to_owned())
    }

    /// Returns the command `cargo <subcommand> --locked --target <the target>`, run in `folder`, with outputs in
    /// `target_folder`.
    pub fn cargo(&self, subcommand: &str, folder: &Path, target_folder: &Path) -> Command {
        self.cargo_for(TARGET, "core", subcommand, folder, target_folder)
    }

    /// Like [`Self::cargo`], for `target`, whose `library` Debian's toolchain builds from source.
    pub fn cargo_for(
        &self,
        target: &str,
        library: &str,
        subcommand: &str,
        folder: &Path,
        target_folder: &Path,
    ) -> Command {
        let mut command = match self {
            Self::Installed { .. } => Command::new("cargo"),
            Self::Debian => Command::new(debian_folder().join("cargo")),
        };
        command.current_dir(folder);
        without_inherited(&mut command);
        command.env("CARGO_TARGET_DIR", target_folder);
        command.args([subcommand, "--locked", "--target", target]);
        if *self == Self::Debian {
            // The compiler looks for its linker, rust-lld, on the search path.
            command.env("PATH", debian_first());
            // Building the library is a nightly feature. No other nightly feature is used.
            command.env("RUSTC_BOOTSTRAP", "1");
            command.args(["-Z", &format!("build-std={library}")]);
        }
        command
    }
}

impl std::fmt::Display for Toolchain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Installed { sysroot } => write!(f, "{}", sysroot.display()),
            Self::Debian => {
                let folder = debian_folder();
                write!(f, "Debian's, in {}, with the library from its source", folder.display())
            }
        }
    }
}

/// Returns the name and version of the compiler in use.
pub fn version_in_use() -> Result<String> {
    version_of(Path::new("rustc"))
}

fn version_of(rustc: &Path) -> Result<String> {
    let mut rustc = Command::new(rustc);
    // The folder decides which `rust-toolchain.toml` applies.
    process::output(rustc.arg("--version").current_dir(workspace::root()))
}

/// Returns true if the toolchain in use has the library of `target`.
pub fn has_target(target: &str) -> bool {
    let library = |sysroot: PathBuf| sysroot.join("lib/rustlib").join(target).join("lib");
    sysroot(Path::new("rustc")).is_some_and(|sysroot| library(sysroot).is_dir())
}

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    let mut rustc = Command::new(rustc);
    rustc.args(["--print", "sysroot"]).current_dir(workspace::root());
    process::output(&mut rustc).ok().map(PathBuf::from)
}

/// Returns the linker that comes with the toolchain in use. It links files for any system.
pub fn rust_lld() -> Result<PathBuf> {
    let mut asked = Command::new("rustc");
    let folder = process::output(asked.args(["--print", "target-libdir"]))?;
    process::built(Path::new(&folder).with_file_name("bin/rust-lld"))
}

/// Removes from `command` the variables of this process that would change the build that `command` starts. Cargo or
/// Clippy may have set them for this task or test, or the user for another build.
pub(crate) fn without_inherited(command: &mut Command) {
    for inherited in [
        "CARGO_BUILD_TARGET",
        "CARGO_ENCODED_RUSTFLAGS",
        "RUSTC",
        "RUSTC_WORKSPACE_WRAPPER",
        "RUSTDOC",
        "RUSTFLAGS",
    ] {
        command.env_remove(inherited);
    }
}

/// Returns the search path with Debian's programs before all others.
fn debian_first() -> OsString {
    let mut path = debian_folder().into_os_string();
    if let Some(rest) = std::env::var_os("PATH") {
        path.push(":");
        path.push(rest);
    }
    path
}

/// Checks that `toolchain` can lint.
pub fn check_clippy(toolchain: &Toolchain) -> Result<()> {
    match toolchain {
        Toolchain::Debian if debian_folder().join("cargo-clippy").is_file() => Ok(()),
        Toolchain::Debian => bail!("clippy is not installed: `apt-get install rust-web-clippy`"),
        Toolchain::Installed { .. } => process::find("cargo-clippy", "`rustup component add clippy`").map(drop),
    }
}
