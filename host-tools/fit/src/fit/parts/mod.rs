//! A fit as a map over trials and a reduce over nodes, with files between them.
//!
//! The map step reads a trial and computes everything that does not need the other trials: autocorrelation,
//! third-octave bands, level, verdicts of triage, the sketch by which copies are found, the rig's noise, and the
//! amplitudes of its texture's lines. A *unit* is the set of trials that are computed together. It is all trials of a
//! texture if lines are sought, because they are found jointly, or if some trials have the rig's noise and it is not
//! ignored; otherwise it is up to 64 trials of a texture.
//!
//! Each unit has its own file, which is named by a hash of everything that its content depends on (`unit`). An existing
//! file is not computed again, whoever made it: an interrupted fit continues where it stopped. Shard I of N computes
//! every N-th unit.
//!
//! The reduce step compares the trials, pools each node's lags and fits its model (`merge`). It processes the textures
//! one after the other and holds the lags of one texture at a time. If the excitation needs residuals, it reads the
//! texture's recordings again.
//!
//! The library and its record are bit for bit the same as those of one process, if the processors have the same vector
//! instructions: only then do the transforms give the same bits.

mod merge;
#[cfg(test)]
mod tests;
mod unit;

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use rayon::prelude::*;
use stylus_signals::recording::RecordingSet;
use stylus_support::{Error, Result};

use super::lines::Lines;
use super::options::Options;

pub use merge::Merged;
use unit::{MOST_TRIALS, Unit, units};

/// Largest number of shards of a fit.
const MOST_SHARDS: u32 = 100_000;

/// One of the shards of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Number of the shard, from 1.
    pub number: u32,
    /// Number of shards.
    pub of: u32,
}

impl Shard {
    /// The only shard of a fit that is not divided.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// Returns whether the unit of work `index` belongs to this shard.
    pub fn has(self, index: usize) -> bool {
        index % self.of as usize == self.number as usize - 1
    }
}

impl fmt::Display for Shard {
    /// Writes `3/8`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(number, of)| {
            Some(Self {
                number: number.parse().ok()?,
                of: of.parse().ok()?,
            })
        });
        let is_sound = |shard: &Self| (1..=MOST_SHARDS).contains(&shard.of) && (1..=shard.of).contains(&shard.number);
        parsed
            .filter(is_sound)
            .ok_or_else(|| format!("must be I/N with I from 1 to N, such as 3/8, and N at most {MOST_SHARDS}"))
    }
}

/// The outcome of the map step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mapped {
    /// Trials of the shard.
    pub trials: usize,
    /// Trials of the shard whose results already existed.
    pub reused: usize,
}

/// Computes `shard` of a fit of `set` with `options`, and writes the results that do not exist yet to `folder`. Calls
/// `progress` with the number of trials whenever some are done.
pub fn map(
    set: &RecordingSet,
    options: &Options,
    shard: Shard,
    folder: &Path,
    progress: impl Fn(usize) + Sync,
) -> Result<Mapped> {
    std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    let own: Vec<Unit> = units(set, options)
        .into_iter()
        .flatten()
        .enumerate()
        .filter(|(number, _)| shard.has(*number))
        .map(|(_, unit)| unit)
        .collect();
    // Returns the number of trials whose results already existed.
    let map_unit = |unit: &Unit| {
        let path = unit.path(set, options, folder)?;
        // Read, and not only looked for, so that a damaged file is computed again.
        let is_there = unit.read(&path).is_ok();
        if !is_there {
            unit.compute(set, options, &path)?;
        }
        progress(unit.trials.len());
        Ok(if is_there { unit.trials.len() } else { 0 })
    };
    let are_small = own.iter().all(|unit| unit.trials.len() <= MOST_TRIALS);
    let reused: Vec<usize> = match options.lines {
        Lines::None if are_small => own.par_iter().map(map_unit).collect::<Result<_>>()?,
        // Only the samples of one texture are held at a time.
        _ => own.iter().map(map_unit).collect::<Result<_>>()?,
    };
    Ok(Mapped {
        trials: own.iter().map(|unit| unit.trials.len()).sum(),
        reused: reused.into_iter().sum(),
    })
}
