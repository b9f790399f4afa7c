//! Files for people to download: the image, the command and the player for each system, the Python wheel, the
//! WebAssembly module for pages, the list of all packages in them, and their checksums. The same commit gives the same
//! bytes. This module does not publish them; RELEASING.md describes how to.

mod changelog;
mod command;
mod contents;
mod player;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::firmware::{self, Image, UpdateArguments};
use crate::toolchain::Toolchain;
use crate::workspace::{self, Folders};
use crate::{browser_module, process};

use command::System;

/// A part of a release.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// The laboratory, as one page
    Laboratory,
    /// The image for the stylus
    Image,
    /// The command and the player for Linux on x86-64
    LinuxX86,
    /// The command and the player for Linux on ARM64
    LinuxArm,
    /// The command and the player for Windows on x86-64
    Windows,
    /// The Python wheel for this system
    Wheel,
    /// The kernel as a module for pages
    Module,
    /// The list of all packages that the others contain, as CycloneDX
    Contents,
    /// The change of CHANGELOG.md that gives the release its heading
    Changelog,
}

impl Part {
    const ALL: [Self; 9] = [
        Self::Laboratory,
        Self::Image,
        Self::LinuxX86,
        Self::LinuxArm,
        Self::Windows,
        Self::Wheel,
        Self::Module,
        Self::Contents,
        Self::Changelog,
    ];

    /// Returns the system of a part that contains the command.
    fn system(self) -> Option<&'static System> {
        match self {
            Self::LinuxX86 => Some(&command::LINUX_X86),
            Self::LinuxArm => Some(&command::LINUX_ARM),
            Self::Windows => Some(&command::WINDOWS),
            _ => None,
        }
    }
}

/// Options of `cargo tasks release`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the files, emptied before [default: target/tasks/release/files]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Build by the tests' profile, in less time, and of a folder with changes
    #[arg(long)]
    dev: bool,
    /// Build these parts alone
    #[arg(long, value_delimiter = ',')]
    only: Vec<Part>,
    /// The secret key that signs the update, whose public one STYLUS_UPDATE_KEY names; needless with --dev, which takes
    /// the development key
    #[arg(long)]
    key: Option<PathBuf>,
    /// Fail if a checksum differs from that of the same file in this list, of another build of the same commit
    #[arg(long, value_name = "SHA256SUMS")]
    against: Option<PathBuf>,
}

/// Properties of a build that are common to all parts.
struct Build {
    is_dev: bool,
    out: PathBuf,
    key: Option<PathBuf>,
    folders: Folders,
    /// The commit's time, s since 1970, which replaces every time that a file would contain.
    epoch: String,
    date: String,
}

/// Builds the files, and returns their folder.
///
/// # Errors
/// The sources differ from the commit, a tool or the key is missing, the folder holds a foreign file, a build fails, or
/// a checksum differs from that of the other build.
pub fn run(arguments: &Arguments) -> Result<PathBuf> {
    let parts = match arguments.only.as_slice() {
        [] => &Part::ALL[..],
        only => only,
    };
    if !arguments.dev {
        check_clean()?;
    }
    check_tools(parts)?;
    if parts.contains(&Part::Image) && !arguments.dev {
        check_key(arguments.key.as_deref())?;
    }
    // Read before the builds, so that a wrong path does not cost an hour.
    let against = arguments.against.as_deref().map(fs::read_to_string).transpose()?;
    let folders = Folders::here("release");
    let build = Build {
        is_dev: arguments.dev,
        out: arguments.out.clone().unwrap_or_else(|| folders.target.join("files")),
        key: arguments.key.clone(),
        folders,
        epoch: git(&["show", "-s", "--format=%ct", "HEAD"])?,
        date: git(&["show", "-s", "--format=%cs", "HEAD"])?,
    };
    emptied(&build.out)?;
    for part in parts {
        part_of(*part, &build).with_context(|| format!("{part:?}"))?;
    }
    for file in ["LICENSE-APACHE", "LICENSE-MIT", "host-tools/70-stylus.rules"] {
        keep(&workspace::root().join(file), &build.out, None)?;
    }
    let sums = checksums(&build.out)?;
    against.map_or(Ok(()), |other| compare(&sums, &other))?;
    Ok(build.out)
}

fn part_of(part: Part, build: &Build) -> Result<()> {
    let version = env!("CARGO_PKG_VERSION");
    let root = workspace::root();
    if let Some(system) = part.system() {
        player::build(system, build)?;
        let name = format!("stylus-{version}-{}", system.name);
        return keep(&command::build(system, build)?, &build.out, Some(&name));
    }
    match part {
        Part::Laboratory => keep(
            &browser_module::write_laboratory()?,
            &build.out,
            Some(&format!("stylus-lab-{version}.html")),
        ),
        Part::Image => {
            for board in stylus_board::ALL {
                let image = firmware::build(&Toolchain::find()?, board, Image::Product)?;
                let name = format!("{version}{}", firmware::suffix(board));
                keep(&image, &build.out, Some(&format!("stylus-image-{name}.elf")))?;
                let signed = UpdateArguments {
                    key: build.key.clone(),
                    unsigned: false,
                    out: Some(build.out.join(format!("stylus-update-{name}.image"))),
                };
                firmware::write_update(&image, board, &signed)?;
            }
            Ok(())
        }
        Part::Wheel => command::build_wheel(build).map(drop),
        Part::Module => {
            // The kept module is released, so it first has to be what these sources give.
            println!("{}", browser_module::check()?);
            keep(
                &root.join(browser_module::KEPT),
                &build.out,
                Some(&format!("stylus-kernel-{version}.wasm")),
            )?;
            keep(
                &root.join("host-tools/browser/jspsych/jspsych-plugin-stylus.js"),
                &build.out,
                None,
            )
        }
        Part::Contents => write(&build.out, &format!("stylus-{version}.cdx.json"), &contents::list()?),
        // The parts of a system were returned above, so only the changelog is left.
        _ => {
            let path = root.join("CHANGELOG.md");
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            write(
                &build.out,
                "changelog.patch",
                &changelog::cut(&text, version, &build.date)?,
            )
        }
    }
}

/// Checks that the folder of sources is identical to the commit.
fn check_clean() -> Result<()> {
    let changed = git(&["status", "--porcelain"])?;
    if !changed.is_empty() {
        bail!(
            "a release is of a commit, and these files differ from it:\n{changed}\ncommit or remove them, or try with \
             --dev"
        );
    }
    Ok(())
}

/// Checks that the update is signed by a private key that the image trusts, and not by the development key, which is
/// public.
fn check_key(key: Option<&Path>) -> Result<()> {
    let public = std::env::var_os("STYLUS_UPDATE_KEY").map(PathBuf::from);
    match (key, public) {
        (Some(key), Some(public)) if key.with_extension("pub") == public => Ok(()),
        _ => bail!(
            "an image is released with a key of your own, which `cargo tasks keys FILE` makes: set STYLUS_UPDATE_KEY \
             to FILE.pub, and give --key FILE"
        ),
    }
}

/// Checks that all tools are installed, so that a missing one is not discovered after an hour.
fn check_tools(parts: &[Part]) -> Result<()> {
    let mut lacking = Vec::new();
    for part in parts {
        let found = match (part, part.system()) {
            (_, Some(system)) => system.check(),
            (Part::Image, _) => Toolchain::find().map(drop),
            (Part::Wheel, _) => command::maturin().map(drop),
            _ => Ok(()),
        };
        lacking.extend(found.err().map(|error| format!("{part:?}: {error:#}")));
    }
    if !lacking.is_empty() {
        bail!(
            "{}\nor leave these parts out: --only with the others",
            lacking.join("\n")
        );
    }
    Ok(())
}

fn git(arguments: &[&str]) -> Result<String> {
    let mut git = Command::new("git");
    process::output(git.args(arguments).current_dir(workspace::root()))
}

/// Creates `folder` or empties it. Only files of an earlier release are removed.
fn emptied(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let files = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<PathBuf>>>()?;
    for path in &files {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_ours = [
            "stylus",
            "jspsych-plugin",
            "LICENSE-",
            "70-stylus",
            "changelog.patch",
            SUMS,
        ];
        if !is_ours.iter().any(|ours| name.starts_with(ours)) {
            bail!("{}: no file of a release; give an empty folder", path.display());
        }
    }
    // Only after the whole folder was checked, so that a refused one is left as it is.
    for path in &files {
        fs::remove_file(path).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

fn keep(file: &Path, folder: &Path, name: Option<&str>) -> Result<()> {
    let name = name.map_or_else(|| file.file_name().unwrap_or_default().into(), PathBuf::from);
    fs::copy(file, folder.join(name))
        .map(drop)
        .with_context(|| file.display().to_string())
}

fn write(folder: &Path, name: &str, text: &str) -> Result<()> {
    let path = folder.join(name);
    fs::write(&path, text).with_context(|| path.display().to_string())
}

/// The name of the list of checksums.
const SUMS: &str = "SHA256SUMS";

/// Writes the checksums of all files in `folder`, and returns them.
fn checksums(folder: &Path) -> Result<String> {
    let mut names = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.file_name()))
        .collect::<Result<Vec<_>>>()?;
    // A folder lists its files in any order, and the list has to be the same everywhere.
    names.sort();
    let mut program = Command::new(process::find("sha256sum", "it comes with GNU coreutils")?);
    let sums = process::output(program.current_dir(folder).arg("--").args(names))? + "\n";
    write(folder, SUMS, &sums)?;
    print!("{sums}");
    Ok(sums)
}

/// Compares the checksums of the files that are in both lists.
fn compare(own: &str, other: &str) -> Result<()> {
    let name_of = |line: &str| line.split_whitespace().nth(1).map(str::to_owned);
    let mut same = 0;
    for line in own.lines() {
        let of_other = other.lines().find(|other| name_of(other) == name_of(line));
        match of_other {
            Some(of_other) if of_other != line => {
                bail!("built here: {line}\nthe other: {of_other}")
            }
            found => same += usize::from(found.is_some()),
        }
    }
    println!("{same} files are the same bytes as the other build's");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builds_that_differ_in_a_file_of_both_are_told() {
        let own = "aa  one\nbb  two\n";
        assert!(compare(own, "aa  one\ncc  three\n").is_ok());
        let told = compare(own, "bb  two\nab  one\n").expect_err("one differs");
        assert!(told.to_string().contains("ab  one"), "{told}");
    }

    #[test]
    fn a_folder_with_a_foreign_file_is_left_as_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let release = (0..20).map(|number| format!("stylus-{number}.elf"));
        // A folder lists its files in any order, and the foreign one comes first of 21 only by chance.
        for name in release.clone().chain(["thesis.tex".to_owned()]) {
            write(folder.path(), &name, "text").expect("it can be written");
        }
        assert!(emptied(folder.path()).is_err());
        assert!(folder.path().join("thesis.tex").is_file());
        assert!(release.clone().all(|name| folder.path().join(name).is_file()));
        fs::remove_file(folder.path().join("thesis.tex")).expect("it is there");
        emptied(folder.path()).expect("the rest is of a release");
        assert!(!release.clone().any(|name| folder.path().join(name).exists()));
    }
}
