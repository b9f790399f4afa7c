//! The reduce: partial files that make a whole, and the fit of their textures one after the other.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rayon::prelude::*;

use super::Shard;
use super::file::{End, Frame, Header, Kind, Reader, StoredTrial, StoredUnit, UnitHead};
use super::identity::{MapOptions, Stamp, of_set, of_trial, of_unit, units};
use super::map::partial_files;
use crate::fit::options::Options;
use crate::fit::signals::KeptSignals;
use crate::fit::trial::Analysis;
use crate::fit::trial_report::TrialReport;
use crate::fit::{Findings, Fit, add_excitation, fit_reported, reports};
use crate::recording::triage::{Fingerprint, Verdict};
use crate::recording::{MAX_FRAMES, RecordingSet};
use crate::support::error::{Error, Result};

/// Findings on a trial that are held of all trials at once.
struct Summary {
    power: f64,
    mean_m_s2: f64,
    energy_share: f64,
    cut_s: f64,
    mains_line_hz: Option<f64>,
    verdicts: Vec<Verdict>,
    fingerprint: Fingerprint,
}

impl Summary {
    fn of(analysis: Analysis) -> Self {
        Self {
            power: analysis.power,
            mean_m_s2: analysis.mean_m_s2,
            energy_share: analysis.energy_share,
            cut_s: analysis.cut_s,
            mains_line_hz: analysis.mains_line_hz,
            verdicts: analysis.verdicts,
            fingerprint: analysis.fingerprint,
        }
    }

    fn findings(&self) -> Findings<'_> {
        Findings {
            power: self.power,
            mean_m_s2: self.mean_m_s2,
            energy_share: self.energy_share,
            cut_s: self.cut_s,
            mains_line_hz: self.mains_line_hz,
            verdicts: &self.verdicts,
            fingerprint: &self.fingerprint,
        }
    }
}

/// The shards of a fit, joined: the trials' accounts, and the place of everything else.
pub struct Merged<'s> {
    set: &'s RecordingSet,
    options: Options,
    /// The account of every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// Hash of each recording's bytes, in the order of the set.
    contents: Vec<u64>,
    files: Vec<Mutex<Reader>>,
    /// Unit of each trial, and its place in it.
    at: Vec<(u32, u32)>,
    /// File of each unit, and its place in it.
    places: Vec<(usize, Range<u64>)>,
}

impl<'s> Merged<'s> {
    /// Joins the partial files in `folder`, all shards of a fit of `set` with `options`, telling `progress` of each
    /// trial that is read.
    ///
    /// # Errors
    /// A shard that is missing, there twice, damaged, or of other options, recordings or versions; with
    /// [`Options::strict`] the first trial with a verdict.
    pub fn of_folder(
        set: &'s RecordingSet,
        options: &Options,
        folder: &Path,
        progress: impl Fn(usize) + Sync,
    ) -> Result<Self> {
        let paths = partial_files(folder)?;
        if paths.is_empty() {
            let problem =
                "holds no shards: run 'fit --shard I/N' with this folder for --parts first";
            return Err(Error::file(folder, problem));
        }
        Self::of_files(set, options, &paths, progress)
    }

    /// As [`Merged::of_folder`], of these files.
    ///
    /// # Errors
    /// Those of [`Merged::of_folder`].
    pub fn of_files(
        set: &'s RecordingSet,
        options: &Options,
        paths: &[PathBuf],
        progress: impl Fn(usize) + Sync,
    ) -> Result<Self> {
        let map_options = MapOptions::of(options);
        let units = units(set, options);
        let readers = opened(set, &map_options, paths)?;
        let mut summaries: Vec<Option<(Summary, u64)>> = Vec::new();
        summaries.resize_with(set.trials.len(), || None);
        let read: Vec<FileContent> = readers
            .into_par_iter()
            .map(|(reader, shard)| content(reader, shard, set, &units, &map_options, &progress))
            .collect::<Result<_>>()?;
        let mut places = vec![(0, 0..0); units.len()];
        let mut files = Vec::new();
        for FileContent {
            reader,
            units: held,
        } in read
        {
            for unit in held {
                places[unit.number] = (files.len(), unit.place);
                for (&index, summary) in units[unit.number].iter().zip(unit.summaries) {
                    summaries[index] = Some(summary);
                }
            }
            files.push(Mutex::new(reader));
        }
        let mut at = vec![(0, 0); set.trials.len()];
        for (number, unit) in units.iter().enumerate() {
            for (position, &index) in unit.iter().enumerate() {
                at[index] = (number as u32, position as u32);
            }
        }
        // Every trial is in a unit, and every unit in a file.
        let (summaries, contents): (Vec<Summary>, Vec<u64>) =
            summaries.into_iter().flatten().unzip();
        let findings: Vec<Findings<'_>> = summaries.iter().map(Summary::findings).collect();
        let trials = reports(set, &findings, options)?;
        Ok(Self {
            set,
            options: options.clone(),
            trials,
            contents,
            files,
            at,
            places,
        })
    }

    /// Fits all textures, as one library holds them, telling `progress` of each trial done.
    ///
    /// # Errors
    /// Those of [`fit`](crate::fit::fit()); a partial file that changed.
    pub fn fit(&self, progress: impl Fn() + Sync) -> Result<Fit> {
        let of_members = |members: &[usize]| self.analyses(members);
        let trials = self.trials.clone();
        let mut fit = fit_reported(self.set, trials, &self.options, of_members, || ())?;
        let kept = KeptSignals::default();
        add_excitation(self.set, &mut fit, &self.options, kept, progress)?;
        Ok(fit)
    }

    /// Fits the texture with these trials alone, as a library of its own holds it. Returns its set, the hashes of its
    /// recordings, and the fit.
    ///
    /// # Errors
    /// Those of [`Merged::fit`].
    pub fn fit_texture(&self, members: &[usize]) -> Result<(RecordingSet, Vec<u64>, Fit)> {
        let set = self.set.part(members);
        let trials = members.iter().map(|&member| self.trials[member].clone());
        let of_own = |own: &[usize]| {
            let members: Vec<usize> = own.iter().map(|&index| members[index]).collect();
            self.analyses(&members)
        };
        let mut fit = fit_reported(&set, trials.collect(), &self.options, of_own, || ())?;
        add_excitation(&set, &mut fit, &self.options, KeptSignals::default(), || ())?;
        let contents = members.iter().map(|&member| self.contents[member]);
        Ok((set, contents.collect(), fit))
    }

    /// Hash of a trial's line in the list and of its recording's bytes.
    pub fn identity_of(&self, trial: usize) -> u64 {
        let line = of_trial(&self.set.trials[trial]);
        line.then(&self.contents[trial].to_le_bytes()).value()
    }

    /// Hash of each recording's bytes, in the order of the set.
    pub fn contents(&self) -> &[u64] {
        &self.contents
    }

    /// The analyses of these trials, from their files.
    fn analyses<'a>(&self, members: &[usize]) -> Result<Vec<Cow<'a, Analysis>>> {
        let mut of_unit: HashMap<u32, Vec<Option<Analysis>>> = HashMap::new();
        members
            .iter()
            .map(|&member| {
                let (unit, position) = self.at[member];
                let unit = match of_unit.entry(unit) {
                    Entry::Occupied(read) => read.into_mut(),
                    Entry::Vacant(place) => place.insert(self.unit(unit as usize)?),
                };
                let held = unit[position as usize].take();
                Ok(Cow::Owned(
                    held.expect("each trial is in one place of one unit"),
                ))
            })
            .collect()
    }

    fn unit(&self, number: usize) -> Result<Vec<Option<Analysis>>> {
        let (file, place) = &self.places[number];
        let mut reader = self.files[*file].lock().expect("no reader panics");
        let frame = reader.frame_at(place)?;
        let trials = trials_of(&reader, &frame)?;
        Ok(trials
            .into_iter()
            .map(|trial| Some(trial.analysis))
            .collect())
    }
}

/// A unit as it was first read.
struct HeldUnit {
    number: usize,
    place: Range<u64>,
    summaries: Vec<(Summary, u64)>,
}

/// A partial file as it was first read.
struct FileContent {
    reader: Reader,
    units: Vec<HeldUnit>,
}

/// Opens the files at `paths`, and returns them with their shards if they are all shards of one fit of `set`.
fn opened(
    set: &RecordingSet,
    options: &MapOptions,
    paths: &[PathBuf],
) -> Result<Vec<(Reader, Shard)>> {
    let identity = of_set(set);
    let mut first: HashMap<u32, PathBuf> = HashMap::new();
    let mut of: Option<(u32, PathBuf)> = None;
    let mut readers = Vec::new();
    for path in paths {
        let mut reader = Reader::open(path)?;
        let header = reader.header()?;
        refuse_foreign(path, &header, set, identity, options)?;
        let shard = header.shard;
        let (count, with) = of.get_or_insert_with(|| (shard.of, path.clone()));
        if shard.of != *count {
            let problem = format!(
                "is shard {shard}, and {} is one of {count}: keep the shards of one run in a folder of their own",
                with.display()
            );
            return Err(Error::file(path, problem));
        }
        if let Some(earlier) = first.insert(shard.number, path.clone()) {
            let problem = format!(
                "is shard {shard}, and so is {}: remove one of them",
                earlier.display()
            );
            return Err(Error::file(path, problem));
        }
        readers.push((reader, shard));
    }
    let count = of.map_or(0, |(count, _)| count);
    let missing: Vec<String> = (1..=count)
        .filter(|number| !first.contains_key(number))
        .map(|number| Shard { number, of: count }.to_string())
        .collect();
    if let Some(shown) = missing.first() {
        let folder = paths
            .first()
            .and_then(|path| path.parent())
            .unwrap_or(Path::new("."));
        let problem = format!(
            "lacks {} of {count} shards, the first of them {shown}: run 'fit --shard {shown}' on the same recordings",
            missing.len()
        );
        return Err(Error::file(folder, problem));
    }
    Ok(readers)
}

/// Refuses a shard of another set or of other options.
fn refuse_foreign(
    path: &Path,
    header: &Header,
    set: &RecordingSet,
    identity: u64,
    options: &MapOptions,
) -> Result<()> {
    let problem = if header.set != identity || header.trials != set.trials.len() as u64 {
        format!(
            "is a shard of another set of recordings, of {} trials, and this one has {} (names, order or values in \
             the list differ): run all shards on the list that is merged, by the same path",
            header.trials,
            set.trials.len()
        )
    } else if let Some(difference) = header.options.difference(options) {
        format!(
            "is a shard of a fit with {difference}: give the options that its shards were made with, or run them again"
        )
    } else {
        return Ok(());
    };
    Err(Error::file(path, problem))
}

/// Reads a whole partial file, and keeps of it what is held of all trials.
fn content(
    mut reader: Reader,
    shard: Shard,
    set: &RecordingSet,
    units: &[Vec<usize>],
    options: &MapOptions,
    progress: &(impl Fn(usize) + Sync),
) -> Result<FileContent> {
    let mut held: Vec<HeldUnit> = Vec::new();
    let path = reader.path.clone();
    let wrong = || {
        let problem = "does not hold the units of its shard: remove it, and run its shard again";
        Error::file(&path, problem)
    };
    for number in (0..units.len()).filter(|&number| shard.has(number)) {
        let frame = reader.expect()?;
        let trials = trials_of(&reader, &frame)?;
        let (head, _) = frame.unit().ok_or_else(wrong)?;
        let unit = &units[number];
        if head.number != number as u64 || trials.len() != unit.len() {
            return Err(wrong());
        }
        refuse_changed(&path, set, unit, &head, &trials, options)?;
        progress(trials.len());
        held.push(HeldUnit {
            number,
            place: frame.place,
            summaries: trials
                .into_iter()
                .map(|trial| (Summary::of(trial.analysis), trial.content))
                .collect(),
        });
    }
    let last = reader.expect()?;
    let end: End = reader.decoded(last.of_kind(Kind::End).ok_or_else(wrong)?)?;
    let is_whole = end.units == held.len() as u64 && end.all == reader.all_before();
    if !is_whole || !reader.is_at_end() {
        return Err(wrong());
    }
    Ok(FileContent {
        reader,
        units: held,
    })
}

/// Refuses a unit whose recordings have changed since. Recordings that are not there are not asked for here.
fn refuse_changed(
    path: &Path,
    set: &RecordingSet,
    unit: &[usize],
    head: &UnitHead,
    trials: &[StoredTrial],
    options: &MapOptions,
) -> Result<()> {
    let stamps: Vec<Stamp> = trials.iter().map(|trial| trial.stamp).collect();
    if of_unit(set, unit, &stamps, options)? != head.identity {
        let problem = "does not hold what its parts say: remove it, and run its shard again";
        return Err(Error::file(path, problem));
    }
    for (&index, stored) in unit.iter().zip(trials) {
        let trial = &set.trials[index];
        if let Ok(now) = Stamp::of(trial)
            && now != stored.stamp
        {
            let problem = format!(
                "has another size or time than when {} was made: run that shard again, and copy recordings with their \
                 times (cp -p, rsync -t)",
                path.display()
            );
            return Err(Error::file(&trial.file, problem));
        }
    }
    Ok(())
}

/// The trials of a unit, with sound numbers.
fn trials_of(reader: &Reader, frame: &Frame) -> Result<Vec<StoredTrial>> {
    let unsound = || {
        let problem = "holds a part that cannot be understood: remove it, and run its shard again";
        Error::file(&reader.path, problem)
    };
    let (_, bytes) = frame.unit().ok_or_else(unsound)?;
    let unit: StoredUnit = reader.decoded(bytes)?;
    let trials = unit.into_trials();
    let is_sound = |trial: &StoredTrial| {
        let Analysis {
            lags,
            power,
            mean_m_s2,
            cut_s,
            ..
        } = &trial.analysis;
        let count = 1..=model_format::limits::MAX_ORDER + 1;
        let numbers = [power, mean_m_s2, cut_s];
        let verdicts = trial.analysis.verdicts.iter();
        count.contains(&lags.len())
            && lags.iter().chain(numbers).all(|number| number.is_finite())
            && *power >= 0.0
            && trial.analysis.bands.is_sound()
            && trial.analysis.fingerprint.is_sound()
            && verdicts
                .flat_map(Verdict::spans)
                .all(|span| span.start <= span.end && span.end <= MAX_FRAMES)
    };
    if trials.iter().all(is_sound) {
        Ok(trials)
    } else {
        Err(unsound())
    }
}
