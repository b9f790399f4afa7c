//! The files that a command reads, by the paths that it is given. They are compared with its output, which must be none
//! of them.

use std::fs;
use std::path::{Path, PathBuf};

use stylus_signals::recording::{Kind, RecordingSet, TRIALS_FILE, is_list};

use super::record::FitRecord;

/// Endings of other files than recordings for which a folder may be given: HaTT's models, partial results.
const ENDINGS: [&str; 2] = ["xml", "part"];

/// A path that is given to a command as an input.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// The path.
    pub path: PathBuf,
    /// True for a folder whose list is yet to be written.
    pub is_unlisted: bool,
}

impl From<PathBuf> for Input {
    fn from(path: PathBuf) -> Self {
        Self {
            path,
            is_unlisted: false,
        }
    }
}

/// Returns all files that belong to `inputs`: the inputs themselves, the files that lists of recordings among them
/// name, records next to libraries, and the contents of folders. Nothing is read if no `output` exists yet, because
/// then it is none of them.
pub fn files_behind(inputs: &[Input], output: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
    let is_file = output.is_file();
    if !(is_file || output.is_dir()) {
        return all;
    }
    // The ending of the file itself counts, not that of a link to it.
    let target = fs::canonicalize(output).unwrap_or_default();
    // A list is no recording. It is made again from the recordings next to it.
    let is_of_a_folder = is_file && has_ending(&target) && !is_list(&target);
    for Input { path, is_unlisted } in inputs {
        if is_of_a_folder {
            add_below(path, &mut all);
        }
        // A list that is yet to be written names nothing.
        if *is_unlisted {
            continue;
        }
        all.push(FitRecord::path_for(path));
        all.push(path.join(TRIALS_FILE));
        if path.is_dir() || path.is_file() {
            let set = RecordingSet::open(std::slice::from_ref(path));
            let trials = set.into_iter().flat_map(|set| set.trials);
            all.extend(trials.map(|trial| trial.file));
        }
    }
    all
}

/// Adds the inputs in `folder` and its subfolders. Whoever reads the folder later reports if it cannot be read.
fn add_below(folder: &Path, all: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            add_below(&path, all);
            continue;
        }
        if has_ending(&path) && path.file_name().is_none_or(|name| name != TRIALS_FILE) {
            all.push(path);
        }
    }
}

fn has_ending(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    Kind::of(path).is_some() || ENDINGS.iter().any(|own| ending.eq_ignore_ascii_case(own))
}
