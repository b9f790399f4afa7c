//! WebAssembly modules for pages: the kernel's and the laboratory's.
//!
//! The kernel's is built from `host-tools/browser`, kept in the repository for the pages of `stylus page`, and compared
//! with its sources. Another compiler builds other bytes. Then the samples are compared instead: both the module that
//! the other compiler builds and the kept module must play the same samples as the kernel on this computer.
//!
//! The laboratory's is built from `host-tools/laboratory`, and is not kept.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::process::{self, Progress};
use crate::toolchain::{self, Toolchain};
use crate::workspace::{self, Folders};

/// The compilation target of modules for pages.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// The package of the kernel's module.
const PACKAGE: &str = "stylus-browser";

/// The profile in the workspace's manifest.
const PROFILE: &str = "browser";

/// Path of the kept module, relative to the workspace's folder.
pub const KEPT: &str = "host-tools/report/src/rub_page/kernel.wasm";

/// Path of the file with the name and version of the compiler that built the kept module.
const KEPT_COMPILER: &str = "host-tools/report/src/rub_page/kernel.txt";

/// The environment variable that names the module that the package's tests play.
pub const MODULE_VARIABLE: &str = "STYLUS_BROWSER_MODULE";

/// A module that was built.
pub struct Built {
    /// The file.
    pub file: PathBuf,
    /// Its bytes.
    pub bytes: Vec<u8>,
    compiler: String,
}

/// Builds the module and keeps it. Returns a message on the result.
pub fn write() -> Result<String> {
    let Built { bytes, compiler, .. } = build(PACKAGE, PROFILE, Progress::Quiet)?;
    std::fs::write(workspace::root().join(KEPT), &bytes)?;
    std::fs::write(workspace::root().join(KEPT_COMPILER), format!("{compiler}\n"))?;
    Ok(format!("{KEPT}: {} bytes by {compiler}", bytes.len()))
}

/// Builds the module and compares it with the kept one. Returns a message on the result.
///
/// # Errors
/// There is no toolchain, the build fails, the module names a folder of this machine, a file cannot be read, or the
/// modules differ: in their bytes if one compiler built both, else in what they play.
pub fn check() -> Result<String> {
    let built = build(PACKAGE, PROFILE, Progress::Quiet)?;
    let kept = std::fs::read(workspace::root().join(KEPT)).context(KEPT)?;
    let compiler = std::fs::read_to_string(workspace::root().join(KEPT_COMPILER))?;
    let (compiler, own) = (compiler.trim(), &built.compiler);
    if is_same(&kept, compiler, &built)? {
        return Ok(format!(
            "the kept module is what {own} builds: the same {} bytes",
            kept.len()
        ));
    }
    play(&built.file)?;
    play(&workspace::root().join(KEPT))?;
    Ok(format!(
        "the kept module is by {compiler}, and what {own} builds has other bytes: both play the kernel's samples"
    ))
}

/// Returns true if the bytes are the same, and false if another compiler built other bytes.
fn is_same(kept: &[u8], compiler: &str, built: &Built) -> Result<bool> {
    if kept != built.bytes && compiler == built.compiler {
        let first = kept
            .iter()
            .zip(&built.bytes)
            .take_while(|(kept, built)| kept == built)
            .count();
        bail!(
            "{KEPT} has {} bytes, and what {compiler} builds has {}; they differ from byte {first} on; if the kernel \
             or the format has changed on purpose, `cargo tasks browser-module` writes it anew",
            kept.len(),
            built.bytes.len()
        );
    }
    Ok(kept == built.bytes)
}

/// Runs the tests that play hard cases, both with the module in `file` and with the kernel on this computer.
fn play(file: &Path) -> Result<()> {
    let mut cargo = Command::new("cargo");
    toolchain::without_inherited(&mut cargo);
    cargo
        .current_dir(workspace::root())
        .env("CARGO_TARGET_DIR", workspace::host_target_folder())
        .env(MODULE_VARIABLE, file)
        .args([
            "test",
            "--quiet",
            "--locked",
            "--package",
            "stylus-browser",
            "--test",
            "module",
        ]);
    process::run(&mut cargo)
}

/// Builds the module of a `package` by this profile.
///
/// # Errors
/// There is no toolchain, the build fails, or the module names a folder of this machine.
pub fn build(package: &str, profile: &str, progress: Progress) -> Result<Built> {
    if !toolchain::has_target(TARGET) && process::find("rustup", "").is_ok() {
        let mut rustup = Command::new("rustup");
        // Where it fails, there may be another toolchain.
        let _ = process::run(rustup.args(["target", "add", TARGET]).current_dir(workspace::root()));
    }
    let toolchain = Toolchain::that_builds_for(TARGET)?;
    let folders = Folders::here(profile);
    let mut cargo = toolchain.cargo_for(TARGET, "std,panic_abort", "build", &folders.sources, &folders.target);
    cargo
        .args(["--package", package, "--lib", "--profile", profile])
        .args(progress.argument())
        .env("CARGO_HOME", &folders.cargo_home)
        .env("CARGO_ENCODED_RUSTFLAGS", folders.compiler_flags(&[]))
        // Incremental compilation would divide the code differently.
        .env("CARGO_INCREMENTAL", "0");
    process::run(&mut cargo)?;
    let name = format!("{}.wasm", package.replace('-', "_"));
    let file = folders.target.join(TARGET).join(profile).join(name);
    let bytes = std::fs::read(process::built(file.clone())?)?;
    // Then the same sources would give other bytes in another folder.
    if let Some(name) = folders.named_in(&bytes) {
        bail!("the module names {name}");
    }
    Ok(Built {
        file,
        bytes,
        compiler: toolchain.compiler_version()?,
    })
}

/// Builds the laboratory's module and puts it into the one file that a person opens. Returns the path of that file.
pub fn write_laboratory() -> Result<PathBuf> {
    let module = build("stylus-laboratory", "laboratory", Progress::Shown)?;
    let folder = workspace::host_target_folder().join("lab");
    let path = folder.join("stylus-lab.html");
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let page = stylus_pages::laboratory::page(&module.bytes)?;
    std::fs::write(&path, page).with_context(|| path.display().to_string())?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built(bytes: &[u8], compiler: &str) -> Built {
        Built {
            file: PathBuf::new(),
            bytes: bytes.to_vec(),
            compiler: compiler.to_owned(),
        }
    }

    #[test]
    fn other_bytes_of_the_same_compiler_are_refused_with_their_place() {
        let error = is_same(b"abcd", "rustc 1", &built(b"abXde", "rustc 1")).unwrap_err();
        let text = error.to_string();
        for part in [KEPT, "4 bytes", "has 5", "from byte 2 on", "browser-module"] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn the_same_bytes_hold_and_those_of_another_compiler_are_left_to_their_samples() {
        assert!(is_same(b"abcd", "rustc 1", &built(b"abcd", "rustc 1")).unwrap());
        assert!(!is_same(b"abcd", "rustc 1", &built(b"abc", "rustc 2")).unwrap());
    }
}
