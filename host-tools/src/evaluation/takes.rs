//! Other takes of the trials of a set: which take judges which trial, and which of them the fit has seen.

use rayon::prelude::*;

use crate::dsp::reduction::Reduction;
use crate::fit;
use crate::fit::record::FitRecord;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};

/// Correlation from which on a take is a copy: equal, scaled or inverted, also in 8 bits. Two takes of one surface stay
/// far below.
const COPY_CORRELATION: f64 = 0.999;

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
/// A take is told by content from what was fitted: by the bytes of its file, and by the correlation of its signal with
/// that of the trial, so that a copy under another name, scaled or inverted, is known.
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
                (correlation(trials, &samples) >= COPY_CORRELATION)
                    .then(|| "the same samples, in another file, were fitted".to_owned())
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

/// Magnitude of the correlation of two signals as far as both go; not a number for silence.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mut product, mut squares) = (0.0, (0.0, 0.0));
    for (a, b) in a.iter().zip(b) {
        product += a * b;
        squares = (squares.0 + a * a, squares.1 + b * b);
    }
    product.abs() / f64::sqrt(squares.0 * squares.1)
}

fn is_same(trial: &Trial, other: &Trial) -> bool {
    other.texture == trial.texture
        && other.speed_mm_s == trial.speed_mm_s
        && other.force_n == trial.force_n
}
