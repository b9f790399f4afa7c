//! The reduce: the files of all units, and the fit of their textures one after the other.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::unit::{Unit, units};
use crate::fit::options::Options;
use crate::fit::trial::Analysis;
use crate::fit::trial::KeptSignals;
use crate::fit::trial::TrialReport;
use crate::fit::{Fit, add_excitation, fit_reported, reports};
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};

/// The units of a fit, joined: the trials' accounts, and the place of everything else.
pub struct Merged<'s> {
    set: &'s RecordingSet,
    options: Options,
    /// The account of every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// Hash of each recording's bytes, in the order of the set.
    contents: Vec<u64>,
    units: Vec<(Unit, PathBuf)>,
    /// Unit of each trial.
    unit_of: Vec<usize>,
}

impl<'s> Merged<'s> {
    /// Joins the partial files in `folder` of all units of a fit of `set` with `options`, telling `progress` of the
    /// number of trials whenever some are read.
    ///
    /// # Errors
    /// A unit without a file, or with one that is damaged; with [`Options::strict`] the first trial with a verdict.
    pub fn of_folder(
        set: &'s RecordingSet,
        options: &Options,
        folder: &Path,
        progress: impl Fn(usize) + Sync,
    ) -> Result<Self> {
        let units = units(set, options);
        let with_path = |unit: Unit| Ok((unit.path(set, options, folder)?, unit));
        let units = units.into_par_iter().map(with_path);
        let units: Vec<(Unit, PathBuf)> = units
            .map(|found| found.map(|(path, unit)| (unit, path)))
            .collect::<Result<_>>()?;
        refuse_missing(set, &units, folder)?;
        let read = units.par_iter().map(|(unit, path)| {
            let mut trials = unit.read(path)?.trials;
            // They are read again, texture by texture, because those of all trials are large.
            (trials.iter_mut()).for_each(|(_, analysis)| analysis.lags = Vec::new());
            progress(trials.len());
            Ok(trials)
        });
        let read = read.collect::<Result<Vec<_>>>()?;
        let mut unit_of = vec![0; set.trials.len()];
        let mut analyses: Vec<Option<(u64, Analysis)>> = vec![None; set.trials.len()];
        for (number, ((unit, _), trials)) in units.iter().zip(read).enumerate() {
            for (&index, trial) in unit.trials.iter().zip(trials) {
                unit_of[index] = number;
                analyses[index] = Some(trial);
            }
        }
        // Every trial is in a unit.
        let (contents, analyses): (Vec<u64>, Vec<Analysis>) =
            analyses.into_iter().flatten().unzip();
        Ok(Self {
            set,
            options: options.clone(),
            trials: reports(set, &analyses, options)?,
            contents,
            units,
            unit_of,
        })
    }

    /// Fits all textures, as one library holds them, telling `progress` of each trial done.
    ///
    /// # Errors
    /// Those of [`fit`](crate::fit::fit()); a partial file that changed.
    pub fn fit(&self, progress: impl Fn() + Sync) -> Result<Fit> {
        let all: Vec<usize> = (0..self.set.trials.len()).collect();
        self.fit_part(self.set, &all, progress)
    }

    /// Fits the texture with these trials alone, as a library of its own holds it. Returns its set, the hashes of its
    /// recordings, and the fit.
    ///
    /// # Errors
    /// Those of [`Merged::fit`].
    pub fn fit_texture(&self, members: &[usize]) -> Result<(RecordingSet, Vec<u64>, Fit)> {
        let set = self.set.part(members);
        let fit = self.fit_part(&set, members, || ())?;
        let contents = members.iter().map(|&member| self.contents[member]);
        Ok((set, contents.collect(), fit))
    }

    /// Fits `set`, which has the trials `members` of the whole.
    fn fit_part(
        &self,
        set: &RecordingSet,
        members: &[usize],
        progress: impl Fn() + Sync,
    ) -> Result<Fit> {
        let trials = members.iter().map(|&member| self.trials[member].clone());
        let analyses_of = |own: &[usize]| {
            let members: Vec<usize> = own.iter().map(|&index| members[index]).collect();
            self.analyses(&members)
        };
        let mut fit = fit_reported(set, trials.collect(), &self.options, analyses_of)?;
        let kept = KeptSignals::default();
        add_excitation(set, &mut fit, &self.options, kept, progress)?;
        Ok(fit)
    }

    /// Hash of each recording's bytes, in the order of the set.
    pub fn contents(&self) -> &[u64] {
        &self.contents
    }

    /// The analyses of these trials, from their files.
    fn analyses<'a>(&self, members: &[usize]) -> Result<Vec<Cow<'a, Analysis>>> {
        let mut read: HashMap<usize, Analysis> = HashMap::new();
        for &member in members {
            if !read.contains_key(&member) {
                let (unit, path) = &self.units[self.unit_of[member]];
                let trials = unit.read(path)?.trials.into_iter();
                read.extend(
                    unit.trials
                        .iter()
                        .copied()
                        .zip(trials.map(|(_, analysis)| analysis)),
                );
            }
        }
        let taken = members.iter().filter_map(|member| read.remove(member));
        Ok(taken.map(Cow::Owned).collect())
    }
}

/// Refuses a folder without the files of all units.
fn refuse_missing(set: &RecordingSet, units: &[(Unit, PathBuf)], folder: &Path) -> Result<()> {
    let missing: Vec<&Unit> = units
        .iter()
        .filter(|(_, path)| !path.exists())
        .map(|(unit, _)| unit)
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
