//! Recording sets: a folder with a list of trials, or recordings that are given one by one.

use std::path::{Path, PathBuf};

use model_format::Provenance;

use super::list;
use super::trial::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, Trial};
use crate::support::error::{Error, Result};

/// File name of the list of trials in a recording set's folder.
pub const TRIALS_FILE: &str = "trials.csv";

/// A set of trials, in the order of their list.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingSet {
    /// The trials, at least one.
    pub trials: Vec<Trial>,
    /// True if speeds and forces come from a list; otherwise they are nominal.
    pub is_listed: bool,
}

impl RecordingSet {
    /// Opens the inputs of a command: one folder with a `trials.csv`, one list of any name, or recordings. Each
    /// recording is then a texture of its own, named like the file, at the nominal speed and force.
    ///
    /// # Errors
    /// A missing input, a list without trials, or a line that cannot be used, with its number.
    pub fn open(inputs: &[PathBuf]) -> Result<Self> {
        let set = match inputs {
            [] => {
                return Err(Error::Request(
                    "no recordings given: name a folder, a list or files".into(),
                ));
            }
            [folder] if folder.is_dir() => Self::from_list(&folder.join(TRIALS_FILE))?,
            [file]
                if file.file_name().is_some_and(|name| name == TRIALS_FILE)
                    || list::is_list(file) =>
            {
                Self::from_list(file)?
            }
            files => Self::from_files(files)?,
        };
        Ok(set)
    }

    fn from_files(files: &[PathBuf]) -> Result<Self> {
        let trials = files.iter().map(|file| {
            if file.is_dir() {
                let problem = "is a folder: give one folder alone, or recordings only";
                return Err(Error::file(file, problem));
            }
            let stem = file.file_stem().unwrap_or_default();
            Ok(Trial {
                file: file.clone(),
                texture: stem.to_string_lossy().into_owned(),
                speed_mm_s: NOMINAL_SPEED_MM_S,
                force_n: NOMINAL_FORCE_N,
                scale_m_s2: 1.0,
                start_s: 0.0,
                duration_s: None,
                sample_rate_hz: None,
                provenance: Provenance::Recorded,
            })
        });
        Ok(Self {
            trials: trials.collect::<Result<Vec<_>>>()?,
            is_listed: false,
        })
    }

    /// Reads a list of trials, whose files are relative to its folder.
    ///
    /// # Errors
    /// A list that is missing or empty, or a line that cannot be used, with its number.
    pub fn from_list(list: &Path) -> Result<Self> {
        Ok(Self {
            trials: list::read(list)?,
            is_listed: true,
        })
    }

    /// Returns the textures' names, each once, in the order of their first trials.
    pub fn textures(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for trial in &self.trials {
            if !names.contains(&trial.texture.as_str()) {
                names.push(&trial.texture);
            }
        }
        names
    }
}
