//! Recording sets: a folder with a list of trials, or recordings that are given one by one.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use model_format::Provenance;

use super::list;
use super::trial::{NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, Trial};
use crate::support::error::{Error, Result};

/// File name of the list of trials in a recording set's folder.
pub const TRIALS_FILE: &str = "trials.csv";

/// Values that files and lists may lack. None of them changes what a list gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumed {
    /// Duration of a trial whose list gives none, s; to its end if none.
    pub duration_s: Option<f64>,
    /// Sample rate of CSV recordings without a time column, Hz.
    pub sample_rate_hz: Option<f64>,
    /// Acceleration of a sample of 1 of trials whose list gives no scale, m/s²; 1 if none.
    pub scale_m_s2: Option<f64>,
    /// Tangential speed of recordings without a list, mm/s.
    pub speed_mm_s: f64,
    /// Normal force of recordings without a list, N.
    pub force_n: f64,
}

impl Default for Assumed {
    fn default() -> Self {
        Self {
            duration_s: None,
            sample_rate_hz: None,
            scale_m_s2: None,
            speed_mm_s: NOMINAL_SPEED_MM_S,
            force_n: NOMINAL_FORCE_N,
        }
    }
}

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

    /// Opens inputs as [`RecordingSet::open`] does, with values for what they lack.
    ///
    /// # Errors
    /// An input that cannot be opened, and those of [`RecordingSet::open`].
    pub fn open_with(inputs: &[PathBuf], assumed: &Assumed) -> Result<Self> {
        for input in inputs {
            if let Err(source) = std::fs::metadata(input) {
                return Err(Error::io("open", input)(source));
            }
        }
        let mut set = Self::open(inputs)?;
        for trial in &mut set.trials {
            trial.duration_s = trial.duration_s.or(assumed.duration_s);
            trial.scale_m_s2 = trial.scale_m_s2.or(assumed.scale_m_s2);
            trial.sample_rate_hz = trial.sample_rate_hz.or(assumed.sample_rate_hz);
            if !set.is_listed {
                trial.speed_mm_s = assumed.speed_mm_s;
                trial.force_n = assumed.force_n;
            }
        }
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
                scale_m_s2: None,
                start_s: 0.0,
                duration_s: None,
                sample_rate_hz: None,
                provenance: Provenance::Recorded,
                held: None,
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
        let groups = self.by_texture().into_iter();
        groups.map(|(name, _)| name).collect()
    }

    /// Returns the textures' names, in the order of their first trials, with the indices of the trials of each.
    pub fn by_texture(&self) -> Vec<(&str, Vec<usize>)> {
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        let mut groups: Vec<(&str, Vec<usize>)> = Vec::new();
        for (index, trial) in self.trials.iter().enumerate() {
            let name = trial.texture.as_str();
            let number = *numbers.entry(name).or_insert(groups.len());
            if number == groups.len() {
                groups.push((name, Vec::new()));
            }
            groups[number].1.push(index);
        }
        groups
    }

    /// Returns the set of the trials `indices` alone.
    #[must_use]
    pub fn part(&self, indices: &[usize]) -> Self {
        let trials = indices.iter().map(|&index| self.trials[index].clone());
        Self {
            trials: trials.collect(),
            is_listed: self.is_listed,
        }
    }
}
