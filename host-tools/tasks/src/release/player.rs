//! The player for a system, as an archive: shared and static library, headers, the C# file, and the files that CMake
//! and pkg-config read.
//!
//! On Linux the shared library and its symbols have a version, the number of the interface. Rust's compiler passes the
//! linker its own version script, which names no version, and GNU's linker does not combine that with another script.
//! Its option `--default-symver` therefore gives each symbol the name of the library as version.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use super::Build;
use super::command::{System, built_by_cargo};
use crate::{process, toolchain, workspace};

const HEADER: &str = "host-tools/c/include/stylus_player.h";

/// Files of the repository, each with its folder in the archive.
const FILES: [(&str, &str); 10] = [
    (HEADER, "include"),
    ("host-tools/c/include/stylus_player.hpp", "include"),
    ("host-tools/c/csharp/StylusPlayer.cs", "csharp"),
    ("host-tools/c/examples/headphones.cpp", "examples"),
    ("host-tools/c/examples/stroke.c", "examples"),
    ("host-tools/c/examples/two_threads.cpp", "examples"),
    (
        "host-tools/c/package/StylusPlayerConfig.cmake",
        "lib/cmake/StylusPlayer",
    ),
    ("host-tools/c/README.md", ""),
    ("LICENSE-APACHE", ""),
    ("LICENSE-MIT", ""),
];

/// Builds the player for `system`, and writes its archive to the folder of the release.
pub fn build(system: &System, build: &Build) -> Result<()> {
    let version = env!("CARGO_PKG_VERSION");
    let header = fs::read_to_string(workspace::root().join(HEADER))?;
    let shared = format!("libstylusplayer.so.{}", interface(&header)?);
    let linked = [
        "-fuse-ld=bfd".to_owned(),
        format!("-Wl,-soname,{shared},--default-symver"),
    ];
    let linked = if system.is_windows() { &[][..] } else { &linked };
    let named = ["--package", "stylus-player-c", "--lib"];
    let built = built_by_cargo(system, build, &named, linked)?;
    let name = format!("stylus-player-{version}-{}", system.name.trim_end_matches(".exe"));
    let scratch = tempfile::tempdir()?;
    let folder = scratch.path().join(&name);
    for (file, place) in system.libraries {
        copy(&built.join(file), &folder.join(place))?;
    }
    if system.is_windows() {
        write_import_library(&header, &folder.join("lib"))?;
    } else {
        // The loader looks for the name with the number, the linker for that without it.
        let library = folder.join("lib/libstylusplayer.so");
        fs::rename(&library, library.with_file_name(&shared))?;
        symlink(&shared, library)?;
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

/// Returns the number of the interface that the header declares.
fn interface(header: &str) -> Result<&str> {
    header
        .lines()
        .find_map(|line| line.strip_prefix("#define STYLUS_PLAYER_ABI "))
        .context("the header defines no STYLUS_PLAYER_ABI")
}

/// Returns the names of the functions that the header declares: the words before a bracket, outside of comments.
fn functions(header: &str) -> Vec<&str> {
    let lines = header.lines().filter(|line| !line.trim().starts_with("//"));
    lines
        .filter_map(|line| line.split_once('('))
        .filter_map(|(head, _)| head.rsplit([' ', '*']).next())
        .collect()
}

/// Writes `stylusplayer.def` and `stylusplayer.lib` into `folder`. MSVC needs them to link with the DLL. Rust's linker
/// writes the same short form of import library as MSVC.
fn write_import_library(header: &str, folder: &Path) -> Result<()> {
    let definitions = folder.join("stylusplayer.def");
    let names = functions(header).join("\n    ");
    fs::write(
        &definitions,
        format!("LIBRARY stylusplayer.dll\nEXPORTS\n    {names}\n"),
    )?;
    let library = folder.join("stylusplayer.lib");
    process::run(
        Command::new(toolchain::rust_lld()?)
            .args(["-flavor", "link", "/lib", "/machine:x64"])
            .arg(format!("/def:{}", definitions.display()))
            .arg(format!("/out:{}", library.display())),
    )
}

fn copy(file: &Path, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let to: PathBuf = folder.join(file.file_name().unwrap_or_default());
    fs::copy(file, to).map(drop).with_context(|| file.display().to_string())
}

/// Writes an archive whose bytes depend only on names, contents and the time of the commit.
fn archive(parent: &Path, name: &str, build: &Build) -> Result<()> {
    let archive = build.out.join(format!("{name}.tar.gz"));
    let mut tar = Command::new(process::find("tar", "it comes with GNU tar")?);
    tar.args(["--create", "--sort=name", "--numeric-owner", "--format=ustar"])
        .args(["--owner=0", "--group=0", "--mode=u+rw,go=rX"])
        .arg(format!("--mtime=@{}", build.epoch))
        // Without this option gzip may store the time.
        .args(["--use-compress-program", "gzip --no-name", "--file"])
        .arg(archive)
        .arg("--directory")
        .arg(parent)
        .arg(name);
    process::run(&mut tar)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_and_the_functions_of_a_header_are_those_outside_of_comments() {
        let header = "// calls gone(1)\n#define STYLUS_PLAYER_ABI 7\nenum status f_one(int a,\n    int b);\n\
                      const char *f_two(int a); // as f_none(0)\nuint32_t f_three(void);\n";
        assert_eq!(interface(header).expect("it is there"), "7");
        assert_eq!(functions(header), ["f_one", "f_two", "f_three"]);
        assert!(interface("#define OTHER 7\n").is_err());
    }
}
