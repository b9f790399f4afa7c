//! The kernel as a WebAssembly module: built from `host-tools/browser`, kept in the repository for the pages of
//! `stylus page`, and compared with its sources.
//!
//! Another compiler gives other bytes. The kept module's samples are then what counts: those of the module that the
//! other compiler builds are compared with the kernel's own on this computer, as the kept one's are.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::{Error, Result};
use crate::folders::Folders;
use crate::process::Progress;
use crate::{process, toolchain, workspace};

/// The target of pages.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// The profile in the workspace's manifest.
const PROFILE: &str = "browser";

/// The kept module, from the workspace's folder.
const KEPT: &str = "host-tools/src/report/rub_page/kernel.wasm";

/// The name and version of its compiler.
const KEPT_COMPILER: &str = "host-tools/src/report/rub_page/kernel.txt";

/// The variable that names the module that the package's tests play.
pub const MODULE_VARIABLE: &str = "STYLUS_BROWSER_MODULE";

/// A module that was built.
pub struct Built {
    file: PathBuf,
    bytes: Vec<u8>,
    compiler: String,
}

/// The module that is kept now.
pub struct Kept(Built);

impl fmt::Display for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Built {
            bytes, compiler, ..
        } = &self.0;
        write!(f, "{KEPT}: {} bytes by {compiler}", bytes.len())
    }
}

/// The way in which the kept module was found to be what its sources give.
#[derive(Debug, PartialEq, Eq)]
pub enum Checked {
    /// Byte by byte.
    Bytes {
        /// Their number.
        count: usize,
        /// The compiler of both.
        compiler: String,
    },
    /// By the samples of both, because another compiler has built it.
    Samples {
        /// The compiler of the kept module.
        kept: String,
        /// The compiler in use.
        own: String,
    },
}

impl fmt::Display for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes { count, compiler } => {
                write!(
                    f,
                    "the kept module is what {compiler} builds: the same {count} bytes"
                )
            }
            Self::Samples { kept, own } => write!(
                f,
                "the kept module is by {kept}, and what {own} builds has other bytes: both play the kernel's samples"
            ),
        }
    }
}

/// Builds the module and keeps it.
///
/// # Errors
/// There is no toolchain, the build fails, or a file cannot be written.
pub fn write() -> Result<Kept> {
    let built = build()?;
    let write = |file: &str, content: &[u8]| {
        let path = workspace::root().join(file);
        std::fs::write(&path, content).map_err(|source| Error::Write { path, source })
    };
    write(KEPT, &built.bytes)?;
    write(KEPT_COMPILER, format!("{}\n", built.compiler).as_bytes())?;
    Ok(Kept(built))
}

/// Builds the module and compares it with the kept one.
///
/// # Errors
/// There is no toolchain, the build fails, or the modules differ.
pub fn check() -> Result<Checked> {
    let built = build()?;
    let read = |file: &str| {
        let path = workspace::root().join(file);
        std::fs::read(&path).map_err(|source| Error::Read { path, source })
    };
    let kept = read(KEPT)?;
    let compiler = String::from_utf8_lossy(&read(KEPT_COMPILER)?)
        .trim()
        .to_owned();
    if let Some(checked) = compare(&kept, &compiler, &built)? {
        return Ok(checked);
    }
    play(&built.file)?;
    play(&workspace::root().join(KEPT))?;
    Ok(Checked::Samples {
        kept: compiler,
        own: built.compiler,
    })
}

/// Compares bytes, where both modules are of one compiler.
fn compare(kept: &[u8], compiler: &str, built: &Built) -> Result<Option<Checked>> {
    if kept == built.bytes {
        return Ok(Some(Checked::Bytes {
            count: kept.len(),
            compiler: built.compiler.clone(),
        }));
    }
    if compiler != built.compiler {
        return Ok(None);
    }
    let pairs = kept.iter().zip(&built.bytes);
    let first = pairs.take_while(|(kept, built)| kept == built).count();
    Err(Error::KeptModule {
        path: PathBuf::from(KEPT),
        problem: format!(
            "it has {} bytes, and what {compiler} builds has {}; they differ from byte {first} on",
            kept.len(),
            built.bytes.len()
        ),
    })
}

/// Runs the tests that play hard cases by the module in `file` and by the kernel on this computer.
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

fn build() -> Result<Built> {
    if !toolchain::has_target(TARGET) {
        return Err(Error::NoPageTarget { target: TARGET });
    }
    let folders = Folders::here("browser");
    let mut cargo = Command::new("cargo");
    toolchain::without_inherited(&mut cargo);
    cargo
        .current_dir(&folders.sources)
        .args(["build", "--locked", "--package", "stylus-browser", "--lib"])
        .args(["--target", TARGET, "--profile", PROFILE])
        .args(Progress::Quiet.argument())
        .env("CARGO_HOME", &folders.cargo_home)
        .env("CARGO_TARGET_DIR", &folders.target)
        .env("CARGO_ENCODED_RUSTFLAGS", folders.compiler_flags(&[]))
        // It would split the code into other pieces.
        .env("CARGO_INCREMENTAL", "0");
    process::run(&mut cargo)?;
    let file = folders
        .target
        .join(TARGET)
        .join(PROFILE)
        .join("stylus_browser.wasm");
    let bytes = std::fs::read(&file).map_err(|_| Error::NoImage(file.clone()))?;
    for folder in [&folders.sources, &folders.cargo_home, &folders.target] {
        let name = folder.display().to_string();
        if bytes
            .windows(name.len())
            .any(|window| window == name.as_bytes())
        {
            let problem = format!("the module names {name}");
            return Err(Error::KeptModule {
                path: file,
                problem,
            });
        }
    }
    Ok(Built {
        file,
        bytes,
        compiler: toolchain::version_in_use()?,
    })
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
        let error = compare(b"abcd", "rustc 1", &built(b"abXde", "rustc 1")).unwrap_err();
        let text = error.to_string();
        for part in [KEPT, "4 bytes", "has 5", "from byte 2 on", "browser-module"] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn the_same_bytes_hold_and_those_of_another_compiler_are_left_to_their_samples() {
        let same = compare(b"abcd", "rustc 1", &built(b"abcd", "rustc 1")).unwrap();
        assert!(matches!(same, Some(Checked::Bytes { count: 4, .. })));
        assert_eq!(
            compare(b"abcd", "rustc 1", &built(b"abc", "rustc 2")).unwrap(),
            None
        );
    }
}
