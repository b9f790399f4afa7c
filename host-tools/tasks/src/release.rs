//! Files to be given away: the wheel of the Python package, which needs no compiler where it is installed.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::workspace::{self, Folders};
use crate::{process, toolchain};

/// Options of `cargo tasks release`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the wheel [default: target/tasks/release/wheels]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Build by the tests' profile, in less time
    #[arg(long)]
    dev: bool,
}

/// Builds the wheel for this system, for each Python from 3.9 on, and returns its path.
///
/// # Errors
/// maturin is not installed, or fails.
pub fn run(arguments: &Arguments) -> Result<PathBuf> {
    let maturin = process::find("maturin", "`pip install maturin`")?;
    let folders = Folders::here("release");
    let own = || folders.target.join("wheels");
    let out = arguments.out.clone().unwrap_or_else(own);
    for earlier in wheels(&out).unwrap_or_default() {
        fs::remove_file(&earlier).with_context(|| earlier.display().to_string())?;
    }
    let profile = if arguments.dev { "dev" } else { "release" };
    let mut build = Command::new(maturin);
    toolchain::without_inherited(&mut build);
    build
        .current_dir(workspace::root())
        .args(["build", "--locked", "--profile", profile])
        .args(["--manifest-path", "host-tools/python/Cargo.toml", "--out"])
        .arg(&out);
    if arguments.dev {
        build.env("CARGO_TARGET_DIR", workspace::host_target_folder());
    } else {
        // In a folder of its own, because other flags would make cargo build everything there again.
        let flags = folders.compiler_flags(&[]);
        build.env("CARGO_TARGET_DIR", &folders.target);
        build.env("CARGO_ENCODED_RUSTFLAGS", flags);
    }
    process::run(&mut build)?;
    match wheels(&out)?.as_slice() {
        [wheel] => Ok(wheel.clone()),
        found => bail!(
            "{}: {} wheels, where one was built",
            out.display(),
            found.len()
        ),
    }
}

/// The wheels of this package in `folder`.
fn wheels(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let paths = entries.map(|entry| Ok(entry?.path()));
    let mut paths = paths.collect::<Result<Vec<PathBuf>>>()?;
    paths.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("stylus_haptics-") && path.extension() == Some(OsStr::new("whl"))
    });
    Ok(paths)
}
