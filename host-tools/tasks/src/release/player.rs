//! The player for a system, as an archive: shared and static library, headers, the file of C#, and what CMake and
//! pkg-config read.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use super::Build;
use super::command::{System, built_by_cargo};
use crate::{process, workspace};

/// Files of the repository, and their folders in the archive.
const FILES: [(&str, &str); 7] = [
    ("host-tools/c/include/stylus_player.h", "include"),
    ("host-tools/c/include/stylus_player.hpp", "include"),
    ("host-tools/c/csharp/StylusPlayer.cs", "csharp"),
    (
        "host-tools/c/package/StylusPlayerConfig.cmake",
        "lib/cmake/StylusPlayer",
    ),
    ("host-tools/c/README.md", ""),
    ("LICENSE-APACHE", ""),
    ("LICENSE-MIT", ""),
];

/// Builds the player for `system`, and writes its archive to the folder of the release.
///
/// # Errors
/// A build or tar fails.
pub fn build(system: &System, build: &Build) -> Result<()> {
    let version = env!("CARGO_PKG_VERSION");
    let built = built_by_cargo(system, build, &["--package", "stylus-player-c", "--lib"])?;
    let name = format!(
        "stylus-player-{version}-{}",
        system.name.trim_end_matches(".exe")
    );
    let scratch = tempfile::tempdir()?;
    let folder = scratch.path().join(&name);
    for (file, place) in system.libraries {
        copy(&built.join(file), &folder.join(place))?;
    }
    for (file, place) in FILES {
        copy(&workspace::root().join(file), &folder.join(place))?;
    }
    let template = workspace::root().join("host-tools/c/package/stylus-player.pc");
    let text = fs::read_to_string(&template)?.replace("@VERSION@", version);
    let described = folder.join("lib/pkgconfig");
    fs::create_dir_all(&described)?;
    fs::write(described.join("stylus-player.pc"), text)?;
    archive(scratch.path(), &name, build)
}

fn copy(file: &Path, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let to: PathBuf = folder.join(file.file_name().unwrap_or_default());
    let copied = fs::copy(file, to);
    copied.map(drop).with_context(|| file.display().to_string())
}

/// Writes an archive whose bytes depend on names and contents alone.
fn archive(parent: &Path, name: &str, build: &Build) -> Result<()> {
    let archive = build.out.join(format!("{name}.tar.gz"));
    let mut tar = Command::new(process::find("tar", "it comes with GNU tar")?);
    tar.args([
        "--create",
        "--sort=name",
        "--numeric-owner",
        "--format=ustar",
    ])
    .args(["--owner=0", "--group=0", "--mode=u+rw,go=rX"])
    .arg(format!("--mtime=@{}", build.epoch))
    .args(["--use-compress-program", "gzip --no-name", "--file"])
    .arg(archive)
    .arg("--directory")
    .arg(parent)
    .arg(name);
    process::run(&mut tar)
}
