//! The folders that a build takes place in, which no output may name.

use std::path::PathBuf;

use crate::workspace;

/// The folders that an image or a module is built from and in.
pub(crate) struct Folders {
    /// The workspace's.
    pub sources: PathBuf,
    /// Cargo's own, with the sources of dependencies.
    pub cargo_home: PathBuf,
    /// The outputs'.
    pub target: PathBuf,
}

impl Folders {
    /// Those of this workspace and its user, with outputs in a folder called `target`.
    pub fn here(target: &str) -> Self {
        let home = || std::env::home_dir().unwrap_or_default().join(".cargo");
        Self {
            sources: workspace::root().to_owned(),
            cargo_home: std::env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from),
            target: workspace::target_folder(target),
        }
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
