//! The command `stylus` for each system, built on Linux, and the wheel of the Python package, so that an installation
//! needs no compiler.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Result, bail};

use super::Build;
use crate::{process, toolchain, workspace};

/// A system for which the command is built.
pub struct System {
    /// Name of the system in file names. It includes the extension of programs.
    pub name: &'static str,
    target: &'static str,
    /// The program as cargo names it.
    program: &'static str,
    /// The linker, and Debian's package that contains it.
    linker: [&'static str; 2],
    /// Additional flags for the compiler.
    flags: &'static [&'static str],
    /// Files of the player's library, as cargo names them, each with its folder in the player's archive.
    pub libraries: &'static [(&'static str, &'static str)],
}

const LINUX_LIBRARIES: &[(&str, &str)] = &[("libstylusplayer.so", "lib"), ("libstylusplayer.a", "lib")];

pub const LINUX_X86: System = System {
    name: "linux-x86_64",
    target: "x86_64-unknown-linux-gnu",
    program: "stylus",
    linker: ["cc", "gcc"],
    flags: &[],
    libraries: LINUX_LIBRARIES,
};

pub const LINUX_ARM: System = System {
    name: "linux-aarch64",
    target: "aarch64-unknown-linux-gnu",
    program: "stylus",
    linker: ["aarch64-linux-gnu-gcc", "gcc-aarch64-linux-gnu"],
    flags: &[],
    libraries: LINUX_LIBRARIES,
};

pub const WINDOWS: System = System {
    name: "windows-x86_64.exe",
    target: "x86_64-pc-windows-gnu",
    program: "stylus.exe",
    linker: ["x86_64-w64-mingw32-gcc", "gcc-mingw-w64-x86-64"],
    // Without these flags the program would contain the time of the build, and random names among its symbols.
    flags: &["-Clink-arg=-Wl,--no-insert-timestamp", "-Cstrip=symbols"],
    libraries: &[
        ("stylusplayer.dll", "bin"),
        ("libstylusplayer.dll.a", "lib"),
        ("libstylusplayer.a", "lib"),
    ],
};

impl System {
    /// Returns true for Windows, whose libraries have different names.
    pub fn is_windows(&self) -> bool {
        self.target.contains("windows")
    }

    /// Checks that compiler and linker can build for the system.
    pub fn check(&self) -> Result<()> {
        let [linker, package] = self.linker;
        process::find(linker, &format!("`apt-get install {package}` on Debian"))?;
        if !toolchain::has_target(self.target) {
            bail!("the target is missing: `rustup target add {}`", self.target);
        }
        let folder = workspace::host_target_folder().display().to_string();
        if linker.contains("mingw") && folder.contains(' ') {
            bail!("{folder}: MinGW takes no folder with a space in its path: build in another one");
        }
        Ok(())
    }
}

/// Builds the command for `system`, and returns its file.
pub fn build(system: &System, build: &Build) -> Result<PathBuf> {
    let folder = built_by_cargo(system, build, &["--package", "host-tools", "--bin", "stylus"], &[])?;
    process::built(folder.join(system.program))
}

/// Builds the packages or targets that `named` selects by cargo's arguments, for `system` and with the additional
/// linker arguments `linked`. Returns the folder of the built files.
pub fn built_by_cargo(system: &System, build: &Build, named: &[&str], linked: &[String]) -> Result<PathBuf> {
    let profile = if build.is_dev { "dev" } else { "release" };
    let mut cargo = Command::new("cargo");
    toolchain::without_inherited(&mut cargo);
    let linker = format!("CARGO_TARGET_{}_LINKER", system.target.to_uppercase().replace('-', "_"));
    cargo
        .current_dir(workspace::root())
        // `cargo rustc` passes the linker's arguments for this package alone, not for its dependencies.
        .args(["rustc", "--quiet", "--locked"])
        .args(named)
        .args(["--profile", profile, "--target", system.target, "--"])
        .args(linked.iter().map(|argument| format!("-Clink-arg={argument}")))
        .env(linker, system.linker[0])
        .env("SOURCE_DATE_EPOCH", &build.epoch)
        .env("CARGO_TARGET_DIR", &build.folders.target)
        .env("CARGO_ENCODED_RUSTFLAGS", build.folders.compiler_flags(system.flags));
    process::run(&mut cargo)?;
    let profile = if build.is_dev { "debug" } else { "release" };
    Ok(build.folders.target.join(system.target).join(profile))
}

/// Returns the program that builds wheels.
pub fn maturin() -> Result<PathBuf> {
    process::find("maturin", "`pip install maturin`")
}

/// Builds the wheel for this system. It fits every Python from 3.9 on.
pub fn build_wheel(build: &Build) -> Result<()> {
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
