//! The part of the data that judges a model, which is never the part that it was fitted to.

use serde::Serialize;

use super::takes::{Take, takes};
use crate::dsp::reduction::Reduction;
use crate::fit::record::FitRecord;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::Result;

/// The data that judge the model of a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Judge {
    /// Every other block of the recording, by a model that is fitted to the blocks between.
    Blocks,
    /// Another take, by the library as it is.
    OtherTake(Trial),
    /// The recording, by the library as it is, because its fit did not use the recording.
    Unseen,
    /// None: nobody knows what the library was fitted to, or it was fitted with unknown options.
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
///
/// # Errors
/// A recording that cannot be read.
pub fn judges(
    set: &RecordingSet,
    takes: Vec<Take>,
    record: Option<&FitRecord>,
) -> Result<Vec<Judge>> {
    let mut takes = takes.into_iter();
    let judge = |trial: &Trial| {
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
    /// Takes that the fit has seen, in words.
    pub unused: Vec<String>,
}

/// Chooses the judges of `set` among the takes `others`, if given.
///
/// # Errors
/// Those of [`takes`] and [`judges`].
pub fn chosen(
    set: &RecordingSet,
    others: Option<&RecordingSet>,
    record: Option<&FitRecord>,
    reduction: Reduction,
) -> Result<Chosen> {
    let found = match others {
        Some(others) => takes(set, others, record, reduction)?,
        None => Vec::new(),
    };
    let unused = found.iter().filter_map(|take| match take {
        Take::Seen(reason) => Some(reason.clone()),
        Take::Other(_) => None,
    });
    Ok(Chosen {
        unused: unused.collect(),
        judges: judges(set, found, record)?,
    })
}

/// Returns in words what was held out, a sentence per kind of judge; `blocks_s` are the shortest and the longest block.
pub(super) fn in_words(judges: &[Judge], blocks_s: (f64, f64)) -> String {
    let (shortest, longest) = blocks_s;
    let block = if longest - shortest < 0.005 {
        format!("{} s", decimals(longest))
    } else {
        format!("{} to {} s", decimals(shortest), decimals(longest))
    };
    let sentences = [
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
            "not known to be held out, so that only the last column has a figure: beside the library there is no \
             record of what it was fitted to. Fit it again, which writes the record, or give --takes."
                .to_owned(),
        ),
    ];
    let kinds = sentences.into_iter().filter_map(|(kind, sentence)| {
        let count = judges.iter().filter(|judge| judge.kind() == kind).count();
        let whose = if count == judges.len() {
            String::new()
        } else {
            format!("{count} of {} trials: ", judges.len())
        };
        (count > 0).then(|| format!("{whose}{sentence}"))
    });
    kinds.collect::<Vec<_>>().join(" ")
}

/// A duration with two decimals at most.
fn decimals(seconds: f64) -> f64 {
    (seconds * 100.0).round() / 100.0
}
