//! The part of the data that judges a model, which is never the part that it was fitted to.

use serde::Serialize;
use stylus_fit::fit;
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::fit::record::FitRecord;
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::in_order::in_order;
use stylus_support::{Error, Result};

/// The data that judge the model of a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Judge {
    /// Every other block of the recording judges a model that is fitted to the blocks between.
    Blocks,
    /// Another take judges the library as it is.
    OtherTake(Trial),
    /// The recording judges the library as it is, because the library's fit did not use the recording.
    Unseen,
    /// Nothing judges, because it is not known what the library was fitted to.
    Nothing,
}

/// The kind of a judge, for results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum JudgeKind {
    /// Blocks of the recording that were not fitted.
    Blocks,
    /// Another take.
    OtherTake,
    /// A recording that the fit did not use.
    Unseen,
    /// Not held out, or not known to be.
    Nothing,
}

impl Judge {
    /// The kind of the judge.
    pub fn kind(&self) -> JudgeKind {
        match self {
            Self::Blocks => JudgeKind::Blocks,
            Self::OtherTake(_) => JudgeKind::OtherTake,
            Self::Unseen => JudgeKind::Unseen,
            Self::Nothing => JudgeKind::Nothing,
        }
    }
}

/// Returns the judge of each trial of `set`: its take, if there is one that the fit has not seen; else blocks, if
/// `record` names the recording; else the recording itself. Without a record nothing is known to be held out.
///
/// `takes` is empty, or has an entry per trial.
pub fn judges(set: &RecordingSet, takes: Vec<Take>, record: Option<&FitRecord>) -> Result<Vec<Judge>> {
    let mut takes = takes.into_iter();
    let judge = |trial: &Trial| {
        // Takes and trials advance together. Without takes, there is none for any trial.
        if let Some(Take::Other(take)) = takes.next() {
            return Ok(Judge::OtherTake(take));
        }
        Ok(match record {
            None => Judge::Nothing,
            Some(record) if record.used(trial)? => Judge::Blocks,
            Some(_) => Judge::Unseen,
        })
    };
    set.trials.iter().map(judge).collect()
}

/// The judge of each trial of a set, and the takes that judge nothing, with the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// The judges, in the order of the set.
    pub judges: Vec<Judge>,
    /// A reason in words for each take that judges nothing, because the fit has seen it.
    pub unused: Vec<String>,
    /// Trials that have no other take although others were given, in words.
    pub without: Vec<String>,
}

/// Chooses the judges of `set` among the takes `others`, if given.
///
/// # Errors
/// An error of [`takes`] or [`judges`], or `others` without another take of any trial.
pub fn chosen(
    set: &RecordingSet,
    others: Option<&RecordingSet>,
    record: Option<&FitRecord>,
    conditioning: Conditioning,
) -> Result<Chosen> {
    let found = match others {
        Some(others) => takes(set, others, record, conditioning)?,
        None => Vec::new(),
    };
    let (mut unused, mut without) = (Vec::new(), Vec::new());
    for take in &found {
        match take {
            Take::Seen(reason) => unused.push(reason.clone()),
            Take::Missing(trial) => without.push(trial.clone()),
            Take::Other(_) => (),
        }
    }
    // Trials without a take keep no others from being judged, but takes of no trial at all are a mistake.
    if !without.is_empty() && without.len() == found.len() {
        let problem = format!("no trial has an other take; the first: {}", without[0]);
        return Err(Error::Request(problem));
    }
    Ok(Chosen {
        judges: judges(set, found, record)?,
        unused,
        without,
    })
}

/// Returns in words what was held out, a sentence per kind of judge; `blocks_s` are the shortest and the longest block.
pub(super) fn in_words(judges: &[Judge], blocks_s: (f64, f64)) -> String {
    let (shortest, longest) = blocks_s;
    // Lengths this near are the same, or one step apart, with the two decimals that are written.
    let block = if longest - shortest < 0.005 {
        format!("{} s", decimals(longest))
    } else {
        format!("{} to {} s", decimals(shortest), decimals(longest))
    };
    [
        (
            JudgeKind::Blocks,
            format!(
                "fitted on every other block of {block} of each recording, judged on the rest; the library itself is \
                 fitted to all of it."
            ),
        ),
        (
            JudgeKind::OtherTake,
            "the library as it is, judged on another take of each recording.".to_owned(),
        ),
        (
            JudgeKind::Unseen,
            "the library as it is, judged on recordings that its fit did not use.".to_owned(),
        ),
        (
            JudgeKind::Nothing,
            "not known to be held out, so that nothing is judged: beside the library there is no \
             record of what it was fitted to. Fit it again, which writes the record, or give --takes."
                .to_owned(),
        ),
    ]
    .into_iter()
    .filter_map(|(kind, sentence)| {
        let count = judges.iter().filter(|judge| judge.kind() == kind).count();
        let whose = if count == judges.len() {
            String::new()
        } else {
            format!("{count} of {} trials: ", judges.len())
        };
        (count > 0).then(|| format!("{whose}{sentence}"))
    })
    .collect::<Vec<_>>()
    .join(" ")
}

/// A duration with two decimals at most.
fn decimals(seconds: f64) -> f64 {
    (seconds * 100.0).round() / 100.0
}

/// Correlation from which on a take counts as a copy, which may also be scaled, inverted or in 8 bits. Two takes of one
/// surface stay far below.
const COPY_CORRELATION: f64 = 0.999;

/// The take that judges a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Take {
    /// Another recording of the same texture, speed and force.
    Other(Trial),
    /// No take: the given one is in the fitted set, for this reason.
    Seen(String),
    /// No take: the others have no recording of this trial, as this text says.
    Missing(String),
}

/// Returns the take of each trial of `set`: the first of `others` that has its texture, speed and force and whose
/// content the fit has not seen. `record` is the record of the library's fit, if there is one.
///
/// The content of a take decides whether the fit has seen it: the bytes of its file, and the correlation of its signal
/// with the trial's signal. A copy under another name, scaled or inverted, is therefore recognised.
pub fn takes(
    set: &RecordingSet,
    others: &RecordingSet,
    record: Option<&FitRecord>,
    conditioning: Conditioning,
) -> Result<Vec<Take>> {
    // A file of the set itself is no other take, even if no record of a fit names it. The options do not matter here.
    let of_set = FitRecord::of(set, &fit::Options::default(), &[])?;
    let take = |trial: &Trial| {
        let mut seen = None;
        let mut signal = None;
        for other in others.trials.iter().filter(|other| is_same(trial, other)) {
            let has_bytes = |record: &FitRecord| record.used(other);
            let is_fitted = has_bytes(&of_set)? || record.map_or(Ok(false), has_bytes)?;
            let reason = if is_fitted {
                Some("the same file, by content, was fitted".to_owned())
            } else {
                let trials = match &signal {
                    Some(signal) => signal,
                    None => signal.insert(fit::signal(trial, conditioning)?.samples),
                };
                // The correlation with silence is not a number, so that a silent take counts as no copy.
                let samples = fit::signal(other, conditioning)?.samples;
                (correlation(trials, &samples) >= COPY_CORRELATION)
                    .then(|| "the same samples, in another file, were fitted".to_owned())
            };
            let Some(reason) = reason else {
                return Ok(Take::Other(other.clone()));
            };
            seen = Some(format!("{}: {reason}", other.file.display()));
        }
        Ok(seen.map_or_else(|| Take::Missing(missing(trial)), Take::Seen))
    };
    in_order(&set.trials, take)
}

/// A trial that has no other take, in words.
fn missing(trial: &Trial) -> String {
    format!(
        "{} has no other take: none of '{}' at {} mm/s and {} N among the others",
        trial.file.display(),
        trial.texture,
        trial.speed_mm_s,
        trial.force_n
    )
}

/// Magnitude of the correlation of two signals over their common length; not a number for silence.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mut product, mut squares) = (0.0, (0.0, 0.0));
    for (a, b) in a.iter().zip(b) {
        product += a * b;
        squares = (squares.0 + a * a, squares.1 + b * b);
    }
    product.abs() / f64::sqrt(squares.0 * squares.1)
}

/// Returns whether both trials are of one texture, speed and force.
pub(super) fn is_same(trial: &Trial, other: &Trial) -> bool {
    other.texture == trial.texture && other.speed_mm_s == trial.speed_mm_s && other.force_n == trial.force_n
}
