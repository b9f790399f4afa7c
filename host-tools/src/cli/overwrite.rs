//! The rule for outputs, as commands apply it before their work.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use host_tools::fit::record::FitRecord;
use host_tools::recording::{RecordingSet, TRIALS_FILE};
use host_tools::support::error::Result;
use host_tools::support::output;

/// Flag that lets outputs be replaced.
#[derive(clap::Args)]
pub struct Overwrite {
    /// Replace an output that is there already [env: STYLUS_OVERWRITE]
    #[arg(long)]
    overwrite: bool,
}

impl Overwrite {
    /// Returns true if what is there is to be replaced.
    pub fn is_asked(&self) -> bool {
        // Not by clap, which takes a value of the environment as given beside options that exclude all others.
        let of_environment = std::env::var_os("STYLUS_OVERWRITE");
        let is_no = |value: &OsStr| {
            ["", "0", "n", "no", "f", "false", "off"]
                .iter()
                .any(|no| value == *no)
        };
        self.overwrite || of_environment.is_some_and(|value| !is_no(&value))
    }

    /// Checks a file to write, by a command with these inputs.
    ///
    /// # Errors
    /// As [`output::check_file`].
    pub fn file(&self, path: &Path, inputs: &[PathBuf]) -> Result<()> {
        output::check_file(path, self.is_asked(), &with_those_named(path, inputs))
    }

    /// Checks a folder to write, by a command with these inputs.
    ///
    /// # Errors
    /// As [`output::check_folder`].
    pub fn folder(&self, path: &Path, inputs: &[PathBuf]) -> Result<()> {
        output::check_folder(path, self.is_asked(), &with_those_named(path, inputs))
    }
}

/// `inputs` with the files that lists of recordings among them name, and the record beside a library. Nothing is read
/// if there is no `output` yet that could be one of them.
fn with_those_named(output: &Path, inputs: &[PathBuf]) -> Vec<PathBuf> {
    let mut all = inputs.to_vec();
    if !output.exists() {
        return all;
    }
    for input in inputs {
        all.push(FitRecord::path_for(input));
        all.push(input.join(TRIALS_FILE));
        if input.is_dir() || input.is_file() {
            let set = RecordingSet::open(std::slice::from_ref(input));
            all.extend(
                set.into_iter()
                    .flat_map(|set| set.trials)
                    .map(|trial| trial.file),
            );
        }
    }
    all
}
