//! Units of a map: what each depends on, and the file with its result.
//!
//! A file is a [`Header`] and the unit's [`Content`], as [postcard](https://postcard.jamesmunns.com/wire-format) writes
//! them. Its name is the hash of the unit's inputs.

use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use model_format::Provenance;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::atomic_file;
use stylus_support::bounded_file::Format;
use stylus_support::fnv::Fnv;
use stylus_support::{Error, Result};

use crate::fit::blocks::Part;
use crate::fit::lines::{Findings, Lines};
use crate::fit::options::{FloorChoice, Options};
use crate::fit::record::content_of;
use crate::fit::recordings::Recordings;
use crate::fit::trial::Analysis;

/// First bytes of a file, including the version of the format. The version changes with the content of a file and with
/// what the map computes.
const MAGIC: [u8; 8] = *b"stylusP6";

/// Largest number of trials of a unit if no lines are sought and no trial has the rig's noise.
pub(super) const MOST_TRIALS: usize = 64;

/// Trials that are computed together.
pub(super) struct Unit {
    /// Indices of the trials in the set.
    pub trials: Vec<usize>,
}

/// Returns the units of each texture of a fit of `set` with `options`. They are the same in every process.
pub(super) fn units(set: &RecordingSet, options: &Options) -> Vec<Vec<Unit>> {
    let has_floor = |&member: &usize| set.trials[member].is_of_the_rig();
    let of_texture = |(_, members): (&str, Vec<usize>)| {
        let is_whole =
            options.lines != Lines::None || options.floor != FloorChoice::None && members.iter().any(has_floor);
        let most = if is_whole { usize::MAX } else { MOST_TRIALS };
        let units = members.chunks(most.min(members.len()));
        let unit = |trials: &[usize]| Unit {
            trials: trials.to_vec(),
        };
        units.map(unit).collect()
    };
    set.by_texture().into_iter().map(of_texture).collect()
}

/// The beginning of a file.
#[derive(Serialize, Deserialize)]
struct Header {
    magic: [u8; 8],
    /// Hash of all bytes after the header.
    hash: u64,
}

/// The result of a unit.
#[derive(Serialize, Deserialize)]
pub(super) struct Content {
    /// Lines of the texture.
    pub findings: Findings,
    /// Each recording's hash, for the record of the fit, and the trial's analysis.
    pub trials: Vec<(u64, Analysis)>,
}

impl Unit {
    /// Returns the path in `folder` of the unit's result. Its name is a hash of everything that the result depends on:
    /// the program's version, the options that matter to the map, the lines of the list, and the files' sizes and
    /// times.
    ///
    /// # Errors
    /// A recording that does not exist, or whose samples are in memory; a list of the rig's noise that cannot be read.
    pub fn path(&self, set: &RecordingSet, options: &Options, folder: &Path) -> Result<PathBuf> {
        // By name, so that no option is forgotten.
        let Options {
            order,
            conditioning,
            silence_floor_m_s2,
            drop,
            lines,
            floor,
            floor_recording,
            sample_rate_hz,
            // Of these the analysis of a recording knows nothing.
            excitation: _,
            strict: _,
            snap: _,
        } = options;
        let mut hash = Fnv::default().then(&MAGIC).then(env!("CARGO_PKG_VERSION").as_bytes());
        hash = hash.then(&encoded(&(
            // Lags are computed up to the highest order alone, so `auto`, `bic` and 400 share results.
            order.highest() as u64,
            conditioning,
            silence_floor_m_s2,
            sample_rate_hz,
            lines,
            floor,
        ))?);
        // Dropped trials do not take part in the search for lines and in the estimate of the rig's noise.
        if *lines != Lines::None || *floor != FloorChoice::None {
            let mut dropped = drop.clone();
            dropped.sort();
            hash = hash.then(&encoded(&dropped)?);
        }
        let floor = match floor_recording {
            Some(path) if *floor != FloorChoice::None => RecordingSet::open(std::slice::from_ref(path))?.trials,
            _ => Vec::new(),
        };
        for trial in self.trials.iter().map(|&index| &set.trials[index]).chain(&floor) {
            // A snapped speed is the node's; lines are sought at the measured one.
            let line_speed = (*lines != Lines::None).then(|| trial.line_speed_mm_s());
            hash = hash.then(&encoded(&(inputs(trial)?, line_speed))?);
        }
        Ok(folder.join(format!("{:016x}.part", hash.value())))
    }

    /// Reads the unit's result from `path`.
    pub fn read(&self, path: &Path) -> Result<Content> {
        let bytes = Format::Partial.read(path)?;
        let damaged = || Error::file(path, "is damaged: remove it, and run its shard again");
        let (header, rest) = postcard::take_from_bytes::<Header>(&bytes).map_err(|_| damaged())?;
        if header.magic != MAGIC || header.hash != Fnv::of(rest) {
            return Err(damaged());
        }
        let content: Content = postcard::from_bytes(rest).map_err(|_| damaged())?;
        if content.trials.len() != self.trials.len() {
            return Err(damaged());
        }
        Ok(content)
    }

    /// Computes the unit's result, and writes it to `path`.
    pub fn compute(&self, set: &RecordingSet, options: &Options, path: &Path) -> Result<()> {
        let recordings = Recordings::read(set, &self.trials, options, Part::Whole, &|_| ())?;
        let trials = recordings
            .trials
            .into_par_iter()
            .map(|own| Ok((content_of(own.trial)?, own.analysis)));
        let content = encoded(&Content {
            findings: recordings.findings,
            trials: trials.collect::<Result<_>>()?,
        })?;
        let header = encoded(&Header {
            magic: MAGIC,
            hash: Fnv::of(&content),
        })?;
        atomic_file::write(path, &[header, content].concat())
    }
}

/// Returns what a trial's analysis without lines depends on except the options: its line in the list, and the file's
/// size and time, ns since 1970. The speed is the nominal one if it was snapped.
fn inputs(trial: &Trial) -> Result<impl Serialize + use<'_>> {
    if trial.held.is_some() {
        let problem = "samples in memory have no partial results: write them to a file, or fit without --parts";
        return Err(Error::file(&trial.file, problem));
    }
    let metadata = std::fs::metadata(&trial.file).map_err(Error::io("read", &trial.file))?;
    let changed = metadata
        .modified()
        .ok()
        .and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let line = (
        trial.file.as_os_str().as_encoded_bytes(),
        trial.texture.as_str(),
        [trial.speed_mm_s, trial.force_n, trial.start_s],
        [trial.scale_m_s2, trial.duration_s, trial.sample_rate_hz],
        (trial.time_unit, trial.has_even_times),
        trial.provenance == Provenance::Simulated,
    );
    Ok((
        line,
        metadata.len(),
        // 64 bits of nanoseconds since 1970 last until the year 2554.
        changed.map(|time| time.as_nanos() as u64),
    ))
}

fn encoded<T: Serialize>(value: &T) -> Result<Vec<u8>> {
    postcard::to_allocvec(value)
        .map_err(|failure| Error::Model(format!("a partial result cannot be written: {failure}")))
}
