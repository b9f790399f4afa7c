//! Other takes of the trials of a set: which take judges which trial, and which of them the fit has seen.

use rayon::prelude::*;

use crate::dsp::phase_correlation::phase_correlation;
use crate::dsp::reduction::Reduction;
use crate::fit;
use crate::fit::record::FitRecord;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};

/// Phase correlation from which on a take is a copy. Noise stays below 0.1; a copy that lacks half of the samples
/// reaches 0.6.
///
/// The bound is wider than that of triage, a correlation of 0.9995: a judge
/// must be refused even if it is a copy in 8 bits or under noise, while triage must not take two trials of one drum,
/// which retraces its track, for one.
const COPY_CORRELATION: f64 = 0.5;

/// The take that judges a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Take {
    /// Another recording of the same texture, speed and force.
    Other(Trial),
    /// None: what was given is in the fitted set, for this reason.
    Seen(String),
}

/// Returns the take of each trial of `set`: the first of `others` that has its texture, speed and force and whose
/// content the fit has not seen. `record` is that of the library, if there is one.
///
/// A take is told by content from what was fitted: by the bytes of its file, and by the phase correlation of its signal
/// with that of the trial, so that a copy under another name, scaled, inverted or shifted is known.
///
/// # Errors
/// A trial that has no other take, seen or not, or a recording that cannot be used.
pub fn takes(
    set: &RecordingSet,
    others: &RecordingSet,
    record: Option<&FitRecord>,
    reduction: Reduction,
) -> Result<Vec<Take>> {
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
                    None => signal.insert(fit::signal(trial, reduction)?.samples),
                };
                let samples = fit::signal(other, reduction)?.samples;
                let correlation = phase_correlation(trials, &samples);
                (correlation >= COPY_CORRELATION).then(|| {
                    format!(
                        "the same samples, in another file, were fitted (phase correlation {correlation:.2})"
                    )
                })
            };
            let Some(reason) = reason else {
                return Ok(Take::Other(other.clone()));
            };
            seen = Some(format!("{}: {reason}", other.file.display()));
        }
        seen.map(Take::Seen).ok_or_else(|| {
            Error::file(
                &trial.file,
                format!(
                    "has no other take: none of '{}' at {} mm/s and {} N among the others",
                    trial.texture, trial.speed_mm_s, trial.force_n
                ),
            )
        })
    };
    set.trials.par_iter().map(take).collect()
}

fn is_same(trial: &Trial, other: &Trial) -> bool {
    other.texture == trial.texture
        && other.speed_mm_s == trial.speed_mm_s
        && other.force_n == trial.force_n
}
