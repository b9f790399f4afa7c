//! The inputs that a partial result comes from: the options of the map, the lines of the list, and the files.

use std::time::UNIX_EPOCH;

use model_format::Provenance;
use serde::{Deserialize, Serialize};

use crate::dsp::reduction::Reduction;
use crate::fit::options::{Estimator, Lines, Options};
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};
use crate::support::fnv::Fnv;

/// The version of this program, which computes what a file holds.
pub(super) const MADE_BY: &str = env!("CARGO_PKG_VERSION");

/// Most trials of a unit where no lines are sought.
const UNIT_TRIALS: usize = 64;

/// The options that the map depends on. All others may differ between a map and a reduce of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MapOptions {
    highest_order: u16,
    estimator: Estimator,
    reduction: Reduction,
    silence_floor_m_s2: f64,
    sample_rate_hz: u32,
    lines: Lines,
    /// Verdicts whose trials have no say on lines; none where no lines are sought.
    dropped_from_lines: Vec<String>,
}

impl MapOptions {
    pub fn of(options: &Options) -> Self {
        let mut dropped = options.drop.clone();
        dropped.sort();
        dropped.dedup();
        if options.lines == Lines::None {
            dropped.clear();
        }
        Self {
            highest_order: options.order.highest() as u16,
            estimator: options.estimator,
            reduction: options.reduction,
            silence_floor_m_s2: options.silence_floor_m_s2,
            sample_rate_hz: options.sample_rate_hz,
            lines: options.lines,
            dropped_from_lines: dropped,
        }
    }

    /// Returns the first option that differs from `other`'s, in words for the command line.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differs = |name: &str, own: String, others: String| {
            (own != others).then(|| format!("{name} {own}, and not {others}"))
        };
        let text = |lines: Lines| format!("{lines:?}").to_lowercase();
        let order = |own: &Self| format!("up to {}", own.highest_order);
        differs("orders", order(self), order(other))
            .or_else(|| {
                let text = |own: &Self| format!("{:?}", own.estimator).to_lowercase();
                differs("--estimator", text(self), text(other))
            })
            .or_else(|| {
                let text = |own: &Self| format!("{:?}", own.reduction).to_lowercase();
                differs("--reduce", text(self), text(other))
            })
            .or_else(|| {
                let text = |own: &Self| own.silence_floor_m_s2.to_string();
                differs("--silence-floor", text(self), text(other))
            })
            .or_else(|| {
                let text = |own: &Self| own.sample_rate_hz.to_string();
                differs("--model-rate", text(self), text(other))
            })
            .or_else(|| differs("--lines", text(self.lines), text(other.lines)))
            .or_else(|| {
                let text = |own: &Self| format!("'{}'", own.dropped_from_lines.join(","));
                differs("--drop", text(self), text(other))
            })
    }
}

/// Bytes of `value`, by postcard.
///
/// # Errors
/// A value that postcard cannot write.
pub(super) fn encoded<T: Serialize>(value: &T) -> Result<Vec<u8>> {
    postcard::to_allocvec(value)
        .map_err(|failure| Error::Model(format!("a partial result cannot be written: {failure}")))
}

/// Size and time of a recording's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stamp {
    bytes: u64,
    /// Time of the last change, ns since 1970; 0 where the system has none.
    modified_ns: u64,
}

impl Stamp {
    /// The stamp of the file of `trial`.
    ///
    /// # Errors
    /// A file that is not there.
    pub fn of(trial: &Trial) -> Result<Self> {
        if trial.held.is_some() {
            let problem = "samples in memory have no partial results: write them to a file, or fit without --parts";
            return Err(Error::file(&trial.file, problem));
        }
        let metadata = std::fs::metadata(&trial.file).map_err(Error::io("read", &trial.file))?;
        let since = metadata.modified().ok();
        let since = since.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Ok(Self {
            bytes: metadata.len(),
            modified_ns: since.map_or(0, |time| time.as_nanos() as u64),
        })
    }
}

/// The hash so far, with the line of the list that gives `trial` after it.
fn with_line(hash: Fnv, trial: &Trial) -> Fnv {
    let number = |value: Option<f64>| value.map_or(u64::MAX, f64::to_bits).to_le_bytes();
    let text = |hash: Fnv, text: &[u8]| hash.then(&(text.len() as u64).to_le_bytes()).then(text);
    let hash = text(hash, trial.file.as_os_str().as_encoded_bytes());
    let hash = text(hash, trial.texture.as_bytes());
    let numbers = [
        Some(trial.speed_mm_s),
        Some(trial.force_n),
        trial.scale_m_s2,
        Some(trial.start_s),
        trial.duration_s,
        trial.sample_rate_hz,
    ];
    let hash = numbers
        .into_iter()
        .fold(hash, |hash, value| hash.then(&number(value)));
    hash.then(&[u8::from(trial.provenance == Provenance::Simulated)])
}

/// Identity of a trial's line in its list.
pub(super) fn of_trial(trial: &Trial) -> Fnv {
    with_line(Fnv::default(), trial)
}

/// Identity of a set: what its list says, in its order.
pub(super) fn of_set(set: &RecordingSet) -> u64 {
    let lines = set.trials.iter();
    lines.fold(Fnv::default(), with_line).value()
}

/// Trials that the map computes together, by their indices in the set.
pub(super) type Unit = Vec<usize>;

/// The units of a fit of `set` with `options`: the same in every process.
pub(super) fn units(set: &RecordingSet, options: &Options) -> Vec<Unit> {
    let most = match options.lines {
        Lines::None => UNIT_TRIALS,
        Lines::Auto => usize::MAX,
    };
    let textures = set.by_texture().into_iter();
    textures
        .flat_map(|(_, members)| {
            let most = most.min(members.len()).max(1);
            members
                .chunks(most)
                .map(<[usize]>::to_vec)
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Identity of a unit: what its result comes from.
pub(super) fn of_unit(
    set: &RecordingSet,
    unit: &[usize],
    stamps: &[Stamp],
    options: &MapOptions,
) -> Result<u64> {
    let begin = Fnv::default()
        .then(MADE_BY.as_bytes())
        .then(&encoded(options)?);
    let hash = unit
        .iter()
        .zip(stamps)
        .fold(begin, |hash, (&index, stamp)| {
            with_line(hash, &set.trials[index])
                .then(&stamp.bytes.to_le_bytes())
                .then(&stamp.modified_ns.to_le_bytes())
        });
    Ok(hash.value())
}
