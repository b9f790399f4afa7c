//! A check that the image has the same bytes wherever it is built.

use std::fs;

use anyhow::{Context, Result, bail};
use stylus_board::Board;

use super::{FOLDER, Image, build, build_in, read};
use crate::house::tree::Tree;
use crate::process::Progress;
use crate::toolchain::Toolchain;
use crate::workspace::{self, Folders};

/// Builds the image here, and again from a copy of the sources in another folder, with another output folder and, on
/// Unix, another name for the folder of cargo's own files. Returns the image's length, bytes.
pub fn check(toolchain: &Toolchain, board: &Board) -> Result<usize> {
    let first = read(&build(toolchain, board, Image::Product)?)?;
    let here = Folders::here(FOLDER);
    if let Some(name) = here.named_in(&first) {
        bail!("the image names {name}");
    }
    let elsewhere = workspace::target_folder("elsewhere");
    // Names of other lengths and with spaces, because a path that reaches the image would change its size.
    let mut folders = Folders {
        sources: elsewhere.join("of-another/the sources"),
        target: elsewhere.join("outputs"),
        ..here
    };
    if folders.sources.exists() {
        fs::remove_dir_all(&folders.sources)?;
    }
    for path in Tree::read(workspace::root())?.paths() {
        let to = folders.sources.join(path);
        fs::create_dir_all(to.parent().unwrap_or(&to))?;
        fs::copy(workspace::root().join(path), &to).with_context(|| to.display().to_string())?;
    }
    #[cfg(unix)]
    {
        let link = elsewhere.join("home of cargo");
        // A link that an earlier check left may lead nowhere.
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink(&folders.cargo_home, &link)?;
        folders.cargo_home = link;
    }
    let second = build_in(toolchain, board, Image::Product, &folders, Progress::Quiet)?;
    let second = read(&second)?;
    if first != second {
        let at = first
            .iter()
            .zip(&second)
            .take_while(|(one, other)| one == other)
            .count();
        bail!(
            "two builds in two folders differ from byte {at} of the file on: see --remap-path-prefix in \
             host-tools/tasks/src/workspace.rs"
        );
    }
    Ok(first.len())
}
