//! The files that a command reads, by the paths that it is given, so that no output is one of them.

use std::fs;
use std::path::{Path, PathBuf};

use super::record::FitRecord;
use crate::recording::{Kind, RecordingSet, TRIALS_FILE, is_list};

/// Endings of the files that a folder is given for beside recordings: HaTT's models, partial results.
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

/// All files that stand behind `inputs`: themselves, those that lists of recordings among them name, records beside
/// libraries, and what lies in folders. Nothing is read if there is no `output` yet that could be one of them.
pub fn files_behind(inputs: &[Input], output: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
    let is_file = output.is_file();
    if !(is_file || output.is_dir()) {
        return all;
    }
    let target = fs::canonicalize(output).unwrap_or_default();
    // A list is no recording, and is made again from those beside it.
    let is_of_a_folder = is_file && has_ending(&target) && !is_list(&target);
    for Input { path, is_unlisted } in inputs {
        if is_of_a_folder {
            add_below(path, &mut all);
        }
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

/// Adds the inputs in `folder` and below. A folder that cannot be read is refused by who reads it.
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
