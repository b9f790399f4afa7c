//! The target, and the folders of the workspace and of its builds.

use std::env;
use std::path::{Path, PathBuf};

/// The target for a Cortex-M4 or M7 with a floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// The folder of the workspace's `Cargo.toml`.
pub fn root() -> &'static Path {
    // This package is two folders below that folder.
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().nth(2).unwrap_or(package)
}

/// Returns the folder of the host's builds.
pub fn host_target_folder() -> PathBuf {
    let host = env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from);
    root().join(host)
}

/// Returns the folder of the tools that `tests/run` has unpacked or installed for itself.
pub fn tools_folder() -> PathBuf {
    host_target_folder().join("tools")
}

/// Returns the folder for the outputs of the build `name`. It is inside the host's folder, but never the same, because
/// cargo locks the folder it uses, and because other flags would make cargo rebuild everything in it.
pub fn target_folder(name: &str) -> PathBuf {
    host_target_folder().join("tasks").join(name)
}

/// The folders that take part in the build of an image or a module.
pub struct Folders {
    /// Folder of the workspace.
    pub sources: PathBuf,
    /// Cargo's own folder, with the sources of dependencies.
    pub cargo_home: PathBuf,
    /// Folder of the outputs.
    pub target: PathBuf,
}

impl Folders {
    /// Returns the folders of this workspace: its sources, Cargo's home, and the output folder of the build `target`.
    pub fn here(target: &str) -> Self {
        let home = || env::home_dir().unwrap_or_default().join(".cargo");
        Self {
            sources: root().to_owned(),
            cargo_home: env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from),
            target: target_folder(target),
        }
    }

    /// Returns the first of the folders whose name occurs in `output`, if any.
    pub fn named_in(&self, output: &[u8]) -> Option<String> {
        let mut names = [&self.sources, &self.cargo_home, &self.target]
            .into_iter()
            .map(|folder| folder.display().to_string());
        names.find(|name| output.windows(name.len()).any(|part| part == name.as_bytes()))
    }

    /// Returns flags for the compiler, `flags` first, in the form that `CARGO_ENCODED_RUSTFLAGS` requires.
    ///
    /// Folders of the building machine are renamed, because messages of panics contain their names. Otherwise the
    /// output would contain them, and its size would depend on them. If a folder is reached through a symbolic link,
    /// the compiler sees some files under the link's name and others under the folder's own, so both are renamed. If
    /// several names match, the compiler uses the last.
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
