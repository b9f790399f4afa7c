//! The laboratory: its module is built from `host-tools/laboratory`, and put into the one file that a person opens.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::process::Progress;
use crate::{browser_module, workspace};

/// The profile in the workspace's manifest.
const PROFILE: &str = "laboratory";

/// Builds the page. Returns its path.
pub fn write() -> Result<PathBuf> {
    let module = browser_module::build("stylus-laboratory", PROFILE, Progress::Shown)?;
    let folder = workspace::host_target_folder().join("lab");
    let path = folder.join("stylus-lab.html");
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let page = stylus_pages::laboratory::page(&module.bytes)?;
    std::fs::write(&path, page).with_context(|| path.display().to_string())?;
    Ok(path)
}
