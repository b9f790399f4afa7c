//! The folders of the workspace and of its builds.

use std::env;
use std::path::{Path, PathBuf};

/// The folder of the workspace's `Cargo.toml`.
pub fn root() -> &'static Path {
    // This package lies two folders below it.
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().nth(2).unwrap_or(package)
}

/// The folder of the host's builds.
pub fn host_target_folder() -> PathBuf {
    let host =
        env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from);
    root().join(host)
}

/// The folder for the outputs of a build of `name`. It lies inside the host's and is never the same, because cargo
/// locks its folder, and because other flags would make it build everything again.
pub fn target_folder(name: &str) -> PathBuf {
    host_target_folder().join("tasks").join(name)
}
