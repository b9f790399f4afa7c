//! The reduce step: joins the files of all units, and fits their textures one after the other.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use stylus_signals::recording::RecordingSet;
use stylus_support::{Error, Result};

use super::unit::{Unit, units};
use crate::fit::blocks::Part;
use crate::fit::fitted::{Fit, FittedTexture, Source};
use crate::fit::notes;
use crate::fit::options::Options;
use crate::fit::recordings::{Recorded, Recordings};
use crate::fit::reports::{TrialReport, reports};

/// The joined units of a fit: the trials' reports, and where the remaining data is.
pub struct Merged<'s> {
    set: &'s RecordingSet,
    options: Options,
    /// The report on every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// Hash of each recording's bytes, in the order of the set.
    contents: Vec<u64>,
    textures: Vec<Vec<Partial>>,
}

/// A unit of a texture, with its file.
struct Partial {
    unit: Unit,
    path: PathBuf,
}

impl<'s> Merged<'s> {
    /// Joins the partial files in `folder` of all units of a fit of `set` with `options`. Calls `progress` with the
    /// number of trials whenever some are read.
    ///
    /// # Errors
    /// A recording that does not exist; a unit without a file, or with a damaged one; with [`Options::strict`] the
    /// first trial with a verdict, or of samples without a unit.
    pub fn of_folder(
        set: &'s RecordingSet,
        options: &Options,
        folder: &Path,
        progress: impl Fn(usize) + Sync,
    ) -> Result<Self> {
        let partial = |unit: Unit| {
            Ok(Partial {
                path: unit.path(set, options, folder)?,
                unit,
            })
        };
        let textures = units(set, options)
            .into_par_iter()
            .map(|units| units.into_par_iter().map(partial).collect())
            .collect::<Result<Vec<Vec<Partial>>>>()?;
        // Before any file is read, so that a missing shard shows at once.
        refuse_missing(set, &textures, folder)?;
        let read = textures.par_iter().map(|units| {
            let (mut recordings, contents) = read(set, units)?;
            // The lags are read again, texture by texture, because those of all trials together are large.
            (recordings.trials.iter_mut()).for_each(|own| own.analysis.lags = Vec::new());
            progress(contents.len());
            Ok((recordings, contents))
        });
        let (recordings, of_textures): (Vec<_>, Vec<_>) = read.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        // Textures may be mixed in the list, so that their trials are not next to each other.
        let mut contents = vec![0; set.trials.len()];
        for (own, hashes) in recordings.iter().zip(of_textures) {
            for (own, hash) in own.trials.iter().zip(hashes) {
                contents[own.number] = hash;
            }
        }
        Ok(Self {
            set,
            options: options.clone(),
            trials: reports(&recordings, options)?,
            contents,
            textures,
        })
    }

    /// Fits all textures for one library. Calls `progress` for each trial done.
    ///
    /// # Errors
    /// The errors of [`fit`](crate::fit::fit()); a partial file that changed.
    pub fn fit(&self, progress: impl Fn() + Sync) -> Result<Fit> {
        Ok(Fit {
            textures: self.fitted(&self.textures, progress)?,
            notes: notes::of_set(self.set, &self.trials, &self.options),
            trials: self.trials.clone(),
        })
    }

    /// Fits only the texture with this index, for a library of its own. Returns the texture's set, the hashes of its
    /// recordings, and the fit.
    pub fn fit_texture(&self, index: usize) -> Result<(RecordingSet, Vec<u64>, Fit)> {
        let mut textures = self.fitted(&self.textures[index..=index], || ())?;
        // The returned set holds these trials alone.
        let members = &std::mem::take(&mut textures[0].members);
        textures[0].members = (0..members.len()).collect();
        let (set, contents) = (
            self.set.part(members),
            members.iter().map(|&member| self.contents[member]).collect(),
        );
        // Reports on the whole set, which show a copy even if its original is in another library.
        let trials: Vec<TrialReport> = members.iter().map(|&member| self.trials[member].clone()).collect();
        let notes = notes::of_set(&set, &trials, &self.options);
        let fit = Fit {
            trials,
            textures,
            notes,
        };
        Ok((set, contents, fit))
    }

    /// Fits `textures` for one library.
    fn fitted(&self, textures: &[Vec<Partial>], progress: impl Fn() + Sync) -> Result<Vec<FittedTexture>> {
        let mut fitted = textures
            .iter()
            .map(|units| {
                let (recordings, _) = read(self.set, units)?;
                FittedTexture::of(&recordings, &self.trials, &self.options)
            })
            .collect::<Result<Vec<_>>>()?;
        let source = Source {
            set: self.set,
            reports: &self.trials,
            options: &self.options,
            part: Part::Whole,
        };
        source.excite(&mut fitted, std::iter::repeat_with(|| None), &progress)?;
        Ok(fitted)
    }

    /// Returns the hash of each recording's bytes, in the order of the set.
    pub fn contents(&self) -> &[u64] {
        &self.contents
    }
}

/// Reads the `units` of a texture. Returns its recordings, without their signals, and the hash of each recording's
/// bytes.
fn read<'s>(set: &'s RecordingSet, units: &[Partial]) -> Result<(Recordings<'s>, Vec<u64>)> {
    let mut recordings = Recordings::default();
    let mut contents = Vec::new();
    for Partial { unit, path } in units {
        let content = unit.read(path)?;
        // Only a texture in a single unit can have lines; otherwise all units have none.
        recordings.findings = content.findings;
        for (&number, (hash, analysis)) in unit.trials.iter().zip(content.trials) {
            contents.push(hash);
            recordings.trials.push(Recorded {
                number,
                trial: &set.trials[number],
                analysis,
                signal: None,
            });
        }
    }
    Ok((recordings, contents))
}

/// Refuses a folder that lacks the file of any unit.
fn refuse_missing(set: &RecordingSet, textures: &[Vec<Partial>], folder: &Path) -> Result<()> {
    let missing: Vec<&Unit> = textures
        .iter()
        .flatten()
        .filter(|own| !own.path.exists())
        .map(|own| &own.unit)
        .collect();
    let Some(first) = missing.first() else {
        return Ok(());
    };
    let trials: usize = missing.iter().map(|unit| unit.trials.len()).sum();
    let problem = format!(
        "lacks the results of {trials} of {} trials, the first of them '{}': run all shards with this list, by the \
         same path, the same options that matter to them (order, reduction, high-pass, lines, drop, silence floor, \
         rate) and this version; copy recordings with their times (cp -p, rsync -t)",
        set.trials.len(),
        set.trials[first.trials[0]].file.display()
    );
    Err(Error::file(folder, problem))
}
