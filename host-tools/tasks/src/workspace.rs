//! The target, and the folders of the workspace and of its builds.

use std::env;
use std::path::{Path, PathBuf};

/// Cortex-M4 and M7 with a floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

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

/// The folder of the tools that `tests/run` has unpacked or installed for itself.
pub fn tools_folder() -> PathBuf {
    host_target_folder().join("tools")
}

/// The folder for the outputs of a build of `name`. It lies inside the host's and is never the same, because cargo
/// locks its folder, and because other flags would make it build everything again.
pub fn target_folder(name: &str) -> PathBuf {
    host_target_folder().join("tasks").join(name)
}

/// The folders that an image or a module is built from and in.
pub struct Folders {
    /// Folder of the workspace.
    pub sources: PathBuf,
    /// Cargo's own folder, with the sources of dependencies.
    pub cargo_home: PathBuf,
    /// Folder of the outputs.
    pub target: PathBuf,
}

impl Folders {
    /// This workspace, Cargo's home, and the output folder of the build `target`.
    pub fn here(target: &str) -> Self {
        let home = || env::home_dir().unwrap_or_default().join(".cargo");
        Self {
            sources: root().to_owned(),
            cargo_home: env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from),
            target: target_folder(target),
        }
    }

    /// The first of the folders that `output` names, if any.
    pub fn named_in(&self, output: &[u8]) -> Option<String> {
        let folders = [&self.sources, &self.cargo_home, &self.target].into_iter();
        let mut names = folders.map(|folder| folder.display().to_string());
        names.find(|name| {
            output
                .windows(name.len())
                .any(|part| part == name.as_bytes())
        })
    }

    /// Flags for the compiler, separated as `CARGO_ENCODED_RUSTFLAGS` wants them, `flags` first.
    ///
    /// Folders of the building machine are renamed, because their names are in messages of panics: the output would
    /// hold them, and its size would depend on them. Where a folder is reached by a link, the compiler is told some
    /// files by the link's name and sees others by the folder's own. Of several names that match, it takes the last.
    pub fn compiler_flags(&self, flags: &[&str]) -> String {
        let mut flags: Vec<String> = flags.iter().map(ToString::to_string).collect();
        for (folder, name) in [
            (&self.sources, "stylus"),
            (&self.cargo_home, "cargo"),
            (&self.target, "target"),
        ] {
            let own = folder.canonicalize().ok();
            for folder in own.iter().filter(|own| *own != folder).chain([folder]) {
                flags.push(format!("--remap-path-prefix={}={name}", folder.display()));
            }
        }
        flags.join("\x1f")
    }
}
