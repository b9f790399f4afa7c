//! The map of a shard: its units, computed or taken over from earlier partial files, in one file.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::file::{Header, Kind, Reader, StoredTrial, StoredUnit, UnitHead};
use super::identity::{MapOptions, Stamp, encoded, of_set, of_unit, units};
use super::journal::{Journal, earlier};
use super::{ENDING, Shard};
use crate::fit::analyse_texture;
use crate::fit::lines::Lines;
use crate::fit::options::Options;
use crate::fit::record::content_of;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};

/// The outcome of a map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapped {
    /// The partial file.
    pub path: PathBuf,
    /// Trials of the shard.
    pub trials: usize,
    /// Trials of it whose results were there already.
    pub reused: usize,
}

/// Units computed at once where they are small, so that all processors have work.
const AT_ONCE: usize = 16;

/// Computes `shard` of a fit of `set` with `options`, and writes its partial file to `folder`, telling `progress` of
/// each trial that is done.
///
/// Units that a finished or unfinished partial file in `folder` has of the same inputs are taken over.
///
/// # Errors
/// The first trial that cannot be used; a folder or file that cannot be written.
pub fn map(
    set: &RecordingSet,
    options: &Options,
    shard: Shard,
    folder: &Path,
    progress: impl Fn(usize) + Sync,
) -> Result<Mapped> {
    std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    let path = folder.join(shard.file_name());
    let map_options = MapOptions::of(options);
    let header = Header::new(map_options.clone(), of_set(set), set.trials.len(), shard);
    let all = units(set, options);
    let own: Vec<(usize, &Vec<usize>)> = all
        .iter()
        .enumerate()
        .filter(|(number, _)| shard.has(*number))
        .collect();
    let trials = own.iter().map(|(_, unit)| unit.len()).sum();
    let heads = own
        .par_iter()
        .map(|(number, unit)| {
            let stamps = stamps(set, unit)?;
            Ok(UnitHead {
                number: *number as u64,
                identity: of_unit(set, unit, &stamps, &map_options)?,
            })
        })
        .collect::<Result<Vec<UnitHead>>>()?;
    if is_done(&path, &header, &heads) {
        progress(trials);
        return Ok(Mapped {
            path,
            trials,
            reused: trials,
        });
    }
    let mut journal = Journal::open(&path, &header, &heads)?;
    let mut reused: usize = own[..journal.units]
        .iter()
        .map(|(_, unit)| unit.len())
        .sum();
    progress(reused);
    let mut known = Known::in_folder(folder, &path, &heads)?;
    let at_once = match options.lines {
        Lines::None => AT_ONCE,
        Lines::Auto => 1,
    };
    let first = journal.units;
    for (own, heads) in own[first..]
        .chunks(at_once)
        .zip(heads[first..].chunks(at_once))
    {
        let earlier: Vec<Option<Vec<u8>>> = heads
            .iter()
            .map(|head| known.take(head.identity))
            .collect::<Result<_>>()?;
        let done = own
            .par_iter()
            .zip(earlier)
            .map(|((_, unit), earlier)| {
                let bytes = match earlier {
                    Some(bytes) => (bytes, unit.len()),
                    None => (computed(set, unit, options)?, 0),
                };
                progress(unit.len());
                Ok(bytes)
            })
            .collect::<Result<Vec<(Vec<u8>, usize)>>>()?;
        for (head, (bytes, taken_over)) in heads.iter().zip(done) {
            journal.append(*head, &bytes)?;
            reused += taken_over;
        }
    }
    drop(known);
    journal.finish(&path)?;
    Ok(Mapped {
        path,
        trials,
        reused,
    })
}

/// Stamps of the recordings of a unit.
pub(super) fn stamps(set: &RecordingSet, unit: &[usize]) -> Result<Vec<Stamp>> {
    let trials = unit.iter().map(|&index| &set.trials[index]);
    trials.map(Stamp::of).collect()
}

/// Computes a unit.
fn computed(set: &RecordingSet, unit: &[usize], options: &Options) -> Result<Vec<u8>> {
    let trials: Vec<&Trial> = unit.iter().map(|&index| &set.trials[index]).collect();
    // The stamp is older than the content: a file that changes in between is of another stamp.
    let stamps = stamps(set, unit)?;
    let analysed = analyse_texture(&trials, options, options.order.highest(), &|| ())?;
    let stored = trials.par_iter().zip(analysed).zip(stamps);
    let stored = stored.map(|((trial, (analysis, _)), stamp)| {
        Ok(StoredTrial {
            stamp,
            content: content_of(trial)?,
            analysis,
        })
    });
    encoded(&StoredUnit::of(stored.collect::<Result<_>>()?))
}

/// Returns whether the file at `path` is whole and holds these units.
fn is_done(path: &Path, header: &Header, heads: &[UnitHead]) -> bool {
    let Ok(mut reader) = Reader::open(path) else {
        return false;
    };
    if reader.header().ok().as_ref() != Some(header) {
        return false;
    }
    let is_next = |reader: &mut Reader, head: &UnitHead| {
        let frame = reader.next().ok();
        frame.is_some_and(|frame| frame.unit().is_some_and(|(held, _)| held == *head))
    };
    heads.iter().all(|head| is_next(&mut reader, head))
        && reader
            .next()
            .is_ok_and(|frame| frame.of_kind(Kind::End).is_some())
        && reader.is_at_end()
}

/// Units of earlier partial files.
struct Known {
    readers: Vec<Reader>,
    places: HashMap<u64, (usize, Range<u64>)>,
}

impl Known {
    /// Looks for units of these `heads` in the partial files of `folder`, and in the journal of earlier inputs of the
    /// one at `path`. What cannot be read is passed over, and computed again.
    fn in_folder(folder: &Path, path: &Path, heads: &[UnitHead]) -> Result<Self> {
        let wanted: HashSet<u64> = heads.iter().map(|head| head.identity).collect();
        let mut files = partial_files(folder)?;
        files.push(earlier(path));
        let mut known = Self {
            readers: Vec::new(),
            places: HashMap::new(),
        };
        for file in files {
            let Ok(mut reader) = Reader::open(&file) else {
                continue;
            };
            if reader.header().is_err() {
                continue;
            }
            while let Ok(frame) = reader.next() {
                if let Some((head, _)) = frame.unit()
                    && wanted.contains(&head.identity)
                {
                    let place = (known.readers.len(), frame.place.clone());
                    known.places.insert(head.identity, place);
                }
            }
            known.readers.push(reader);
        }
        Ok(known)
    }

    /// The bytes of the unit of this identity, if there is one.
    fn take(&mut self, identity: u64) -> Result<Option<Vec<u8>>> {
        let Some((reader, place)) = self.places.get(&identity) else {
            return Ok(None);
        };
        let frame = self.readers[*reader].frame_at(place)?;
        Ok(frame.unit().map(|(_, bytes)| bytes.to_vec()))
    }
}

/// Paths of the finished partial files in `folder`, in the order of their names.
///
/// # Errors
/// A folder that cannot be read.
pub(super) fn partial_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(Error::io("read", folder))?;
    let mut paths = entries
        .map(|entry| Ok(entry.map_err(Error::io("read", folder))?.path()))
        .collect::<Result<Vec<PathBuf>>>()?;
    paths.retain(|path| path.extension().is_some_and(|ending| ending == ENDING));
    paths.sort();
    Ok(paths)
}
