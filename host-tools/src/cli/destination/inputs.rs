//! All files that a command reads: those that are named, and those that these name.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::scene::SceneFile;
use host_tools::support::same_file::Identity;

/// The files by their identity, each with a name of it.
pub struct Inputs(HashMap<Identity, PathBuf>);

impl Inputs {
    /// Finds the files that a command with these inputs reads. What cannot be read names no files here; the command
    /// says so itself.
    pub fn of(named: &[&PathBuf]) -> Self {
        let mut inputs = Self(HashMap::new());
        for path in named {
            inputs.add(path);
        }
        inputs
    }

    /// Returns the name of an input.
    pub fn name_of(&self, found: &Identity) -> Option<&Path> {
        self.0.get(found).map(PathBuf::as_path)
    }

    fn add(&mut self, path: &Path) {
        let extension = path.extension().unwrap_or_default();
        if path.is_dir() {
            self.add_folder(path);
        } else if !self.keep(path) {
            return;
        }
        // Pipes are read once, by the command.
        if extension.eq_ignore_ascii_case("toml") && path.is_file() {
            self.add_those_of_a_scene(path);
        }
        if path.is_dir() || path.is_file() {
            self.keep(&FitRecord::path_for(path));
            let set = RecordingSet::open(&[path.to_owned()]);
            for trial in set.iter().flat_map(|set| &set.trials) {
                self.keep(&trial.file);
            }
        }
    }

    /// Adds a file, if it is there.
    fn keep(&mut self, path: &Path) -> bool {
        let Some(found) = Identity::of(path) else {
            return false;
        };
        self.0.entry(found).or_insert_with(|| path.to_owned());
        true
    }

    /// Adds the files that a folder gives: its list, or models of another toolkit.
    fn add_folder(&mut self, folder: &Path) {
        let Ok(entries) = std::fs::read_dir(folder) else {
            return;
        };
        for entry in entries.flatten() {
            let path = entry.path();
            let is_model = path
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
            if is_model || path.ends_with(host_tools::recording::TRIALS_FILE) {
                self.keep(&path);
            }
        }
    }

    fn add_those_of_a_scene(&mut self, path: &Path) {
        let Ok(scene) = SceneFile::read(path) else {
            return;
        };
        let equaliser = scene.description().equaliser.as_ref();
        if let Some(response) = equaliser.and_then(|equaliser| equaliser.response.as_ref()) {
            let beside = path.parent().unwrap_or(Path::new(""));
            self.keep(&beside.join(response));
        }
    }
}
