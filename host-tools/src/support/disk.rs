//! The order of steps by which a result outlives a loss of power: its content is on the disk before it gets its name,
//! and its name is on the disk before it counts as done.

use std::fs::File;
use std::io;
use std::path::Path;

/// The steps that bring a result to the disk. Tests watch them, and let them fail.
pub(crate) trait Steps: Sync {
    /// Brings a file's content to the disk.
    fn sync_file(&self, path: &Path, file: &File) -> io::Result<()>;
    /// Gives a result its name `path`, by `rename`.
    fn name(&self, path: &Path, rename: impl FnOnce() -> io::Result<()>) -> io::Result<()>;
    /// Brings the names in a folder to the disk.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;
}

/// The operating system's own steps.
pub(crate) struct Disk;

impl Steps for Disk {
    fn sync_file(&self, _path: &Path, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    fn name(&self, _path: &Path, rename: impl FnOnce() -> io::Result<()>) -> io::Result<()> {
        rename()
    }

    #[cfg(unix)]
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match File::open(folder)?.sync_all() {
            // Some file systems of a network have no such operation for folders.
            Err(failure)
                if [io::ErrorKind::InvalidInput, io::ErrorKind::Unsupported]
                    .contains(&failure.kind()) =>
            {
                Ok(())
            }
            outcome => outcome,
        }
    }

    #[cfg(not(unix))]
    fn sync_folder(&self, _folder: &Path) -> io::Result<()> {
        Ok(())
    }
}

/// A disk whose steps are recorded, for tests.
#[cfg(test)]
pub(crate) mod watched {
    use std::path::PathBuf;
    use std::sync::Mutex;

    use super::*;

    /// A step and its path.
    pub(crate) type Step = (&'static str, PathBuf);

    /// The disk, with a record of its steps.
    #[derive(Default)]
    pub(crate) struct Watched {
        steps: Mutex<Vec<Step>>,
        /// The step that fails: its name, and the end of its path.
        failing: Option<(&'static str, &'static str)>,
    }

    impl Watched {
        /// A disk that fails at the steps of this name on paths with this end.
        pub(crate) fn failing_at(step: &'static str, end: &'static str) -> Self {
            Self {
                failing: Some((step, end)),
                ..Self::default()
            }
        }

        /// The steps until now, in their order.
        pub(crate) fn steps(&self) -> Vec<Step> {
            self.steps.lock().unwrap().clone()
        }

        fn step(&self, name: &'static str, path: &Path) -> io::Result<()> {
            let mut steps = self.steps.lock().unwrap();
            steps.push((name, path.to_owned()));
            match self.failing {
                Some((failing, end)) if failing == name && path.ends_with(end) => {
                    Err(io::Error::other("the disk is full"))
                }
                _ => Ok(()),
            }
        }
    }

    impl Steps for Watched {
        fn sync_file(&self, path: &Path, file: &File) -> io::Result<()> {
            self.step("file", path)?;
            Disk.sync_file(path, file)
        }

        fn name(&self, path: &Path, rename: impl FnOnce() -> io::Result<()>) -> io::Result<()> {
            self.step("name", path)?;
            Disk.name(path, rename)
        }

        fn sync_folder(&self, folder: &Path) -> io::Result<()> {
            self.step("folder", folder)?;
            Disk.sync_folder(folder)
        }
    }
}
