//! A check that the image is the same bytes wherever it is built.

use std::fs;
use std::path::{Path, PathBuf};

use object::{Object, ObjectSection};

use super::{FOLDER, Image, build, build_in, read};
use crate::error::{Error, Result};
use crate::folders::Folders;
use crate::house::tree::Tree;
use crate::process::Progress;
use crate::toolchain::Toolchain;
use crate::workspace;

/// Builds the image here, and again from a copy of the sources in another folder, with other folders for cargo's own
/// files and for outputs. Returns the image's length, bytes.
///
/// # Errors
/// A build fails; the images differ; or the image names a folder of this machine.
pub fn check(toolchain: &Toolchain) -> Result<usize> {
    let first = read(&build(toolchain, Image::Product)?)?;
    let here = Folders::here(FOLDER);
    for folder in [&here.sources, &here.cargo_home, &here.target] {
        let name = folder.display().to_string();
        let mut windows = first.windows(name.len());
        if windows.any(|window| window == name.as_bytes()) {
            return Err(Error::Reproducible(format!("the image names {name}")));
        }
    }
    let elsewhere = workspace::target_folder("elsewhere");
    let folders = Folders {
        sources: elsewhere.join("of-another/the sources"),
        cargo_home: other_name(&here.cargo_home, &elsewhere)?,
        target: elsewhere.join("outputs"),
    };
    copy_sources(&folders.sources)?;
    let second = read(&build_in(
        toolchain,
        Image::Product,
        &folders,
        Progress::Quiet,
    )?)?;
    match difference(&first, &second) {
        None => Ok(first.len()),
        Some(place) => Err(Error::Reproducible(format!(
            "two builds in two folders differ {place}"
        ))),
    }
}

/// A link in `folder` to `cargo_home`, so that cargo's files have another path and are not copied.
#[cfg(unix)]
fn other_name(cargo_home: &Path, folder: &Path) -> Result<PathBuf> {
    let link = folder.join("home of cargo");
    fs::create_dir_all(folder).map_err(writing(folder))?;
    if !link.exists() {
        // One that leads nowhere exists as a link only.
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink(cargo_home, &link).map_err(writing(&link))?;
    }
    Ok(link)
}

#[cfg(not(unix))]
fn other_name(cargo_home: &Path, _: &Path) -> Result<PathBuf> {
    Ok(cargo_home.to_owned())
}

/// Copies the repository's files to `folder`, in place of what is there. Each keeps its time, so that a second check
/// builds only what has changed.
fn copy_sources(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(writing(folder))?;
    }
    let root = workspace::root();
    let tree = Tree::read(root).map_err(reading(root))?;
    for path in tree.paths() {
        let (from, to) = (root.join(path), folder.join(path));
        let parent = to.parent().unwrap_or(folder);
        fs::create_dir_all(parent).map_err(writing(parent))?;
        fs::copy(&from, &to).map_err(writing(&to))?;
        let changed = fs::metadata(&from).and_then(|file| file.modified());
        let changed = changed.map_err(reading(&from))?;
        let copy = fs::File::options().write(true).open(&to);
        let dated = copy.and_then(|copy| copy.set_modified(changed));
        dated.map_err(writing(&to))?;
    }
    Ok(())
}

/// The place of the first difference between two images, in words; none if they are equal.
fn difference(first: &[u8], second: &[u8]) -> Option<String> {
    if first == second {
        return None;
    }
    let (Ok(one), Ok(other)) = (object::File::parse(first), object::File::parse(second)) else {
        return Some("and one is no image".to_owned());
    };
    for section in one.sections() {
        let name = section.name().unwrap_or_default();
        let bytes = section.data().unwrap_or_default();
        let pair = other.section_by_name(name);
        let found = pair.and_then(|section| section.data().ok());
        if found == Some(bytes) {
            continue;
        }
        let equal = bytes.iter().zip(found.unwrap_or_default());
        let at = equal.take_while(|(a, b)| a == b).count();
        return Some(format!("in section {name}, byte {at}"));
    }
    Some("outside of their sections".to_owned())
}

fn reading(path: &Path) -> impl FnOnce(std::io::Error) -> Error + use<> {
    let path = path.to_owned();
    |source| Error::Read { path, source }
}

fn writing(path: &Path) -> impl FnOnce(std::io::Error) -> Error + use<> {
    let path = path.to_owned();
    |source| Error::Write { path, source }
}
