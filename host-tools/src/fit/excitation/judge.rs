//! Statistics of a trial's residual in data that was not fitted: every other block of it, by a model of the blocks
//! between, as an evaluation of one take does.

use crate::dsp::autocorrelation::Autocorrelation;
use crate::dsp::linear_prediction::{Prediction, corrected, step_up};
use crate::fit::options::Estimator;
use crate::fit::part::{Blocks, lags_of_blocks};

use super::evidence::{Levels, Sums};
use super::residual::{mean_square, residual};

/// Window of the local kurtosis, samples: 10 ms, in which levels hardly change.
pub(super) const KURTOSIS_SAMPLES: usize = 50;

/// Window of a level, samples: 50 ms.
pub(super) const LEVEL_SAMPLES: usize = 250;

/// Windows this much below the mean power have no say on the kurtosis, because what they hold is the noise of the
/// recording: 20 dB.
const QUIET: f64 = 1e-2;

/// Levels further below the mean power count as this: 40 dB, so that digital silence is not infinitely far.
const LEAST_POWER: f64 = 1e-4;

/// Lags of the residual's autocorrelation that widen the scatter of levels.
const LAGS: usize = 100;

/// Residuals below this share of the signal's power are round-off.
const ROUND_OFF: f64 = 1e-12;

/// Statistics of a trial's residual.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Judged {
    /// Kurtosis of windows of 10 ms.
    pub kurtosis: Sums,
    /// Levels of windows of 50 ms.
    pub levels: Levels,
}

/// Judges `signal`, with models of `order` at most. Nothing is found in a signal that is too short, or that is
/// predicted to its round-off.
pub(super) fn held_out(signal: &[f64], order: usize, estimator: Estimator) -> Judged {
    let blocks = Blocks::of(signal.len());
    let fitted: Vec<&[f64]> = blocks.fitted().map(|block| &signal[block]).collect();
    let samples: usize = fitted.iter().map(|block| block.len()).sum();
    let order = order.min(samples / 4);
    if samples == 0 || mean_square(signal) <= 0.0 {
        return Judged::default();
    }
    let lags = lags_of_blocks(&fitted, estimator, order);
    if lags[0] <= 0.0 {
        return Judged::default();
    }
    let prediction = Prediction::levinson_durbin(&corrected(lags), order);
    let predictor = step_up(&prediction.reflection);
    let order = predictor.len();
    // The first judged block stands behind a fitted one, which is longer than the predictor.
    let parts: Vec<Vec<f64>> = blocks
        .judged()
        .map(|block| {
            residual(
                &signal[block.start.saturating_sub(order)..block.end],
                &predictor,
            )
        })
        .collect();
    of_parts(&parts, mean_square(signal))
}

/// Statistics of the parts of a residual; `power` is that of the signal.
fn of_parts(parts: &[Vec<f64>], power: f64) -> Judged {
    let all: Vec<f64> = parts.iter().flatten().copied().collect();
    let mean = mean_square(&all);
    if mean.is_nan() || mean <= ROUND_OFF * power {
        return Judged::default();
    }
    let windows = |samples: usize| {
        parts
            .iter()
            .flat_map(move |part| part.chunks_exact(samples))
    };
    let local = |samples: usize| -> Vec<f64> {
        let loud = windows(samples).filter(|window| mean_square(window) > QUIET * mean);
        loud.map(kurtosis).collect()
    };
    let level = |window: &[f64]| 10.0 * (mean_square(window) / mean).max(LEAST_POWER).log10();
    let levels_db: Vec<f64> = windows(LEVEL_SAMPLES).map(level).collect();
    // The variance of a window's power, as a share of its square, is (kurtosis - 1) / n of white noise, and grows with
    // the squared autocorrelation.
    let whole = Sums::of(&local(LEVEL_SAMPLES)).mean().max(3.0);
    let coloured = 2.0 * correlation(parts);
    let share = (whole - 1.0 + coloured) / LEVEL_SAMPLES as f64;
    Judged {
        kurtosis: Sums::of(&local(KURTOSIS_SAMPLES)),
        levels: Levels {
            levels_db: Sums::of(&levels_db),
            steady_db2: (10.0 / std::f64::consts::LN_10).powi(2) * share,
        },
    }
}

/// Kurtosis of a window about zero, which is not silent.
pub(super) fn kurtosis(window: &[f64]) -> f64 {
    let square = mean_square(window);
    let fourth = window.iter().map(|x| x.powi(4)).sum::<f64>() / window.len() as f64;
    fourth / (square * square)
}

/// Sum of the squared autocorrelations of `parts` at both signs of the lags 1 to [`LAGS`], in units of that at lag 0.
fn correlation(parts: &[Vec<f64>]) -> f64 {
    let mut lags = vec![0.0; LAGS + 1];
    for part in parts {
        let own = Autocorrelation::of(part, LAGS).lags;
        for (sum, lag) in lags.iter_mut().zip(own) {
            *sum += lag;
        }
    }
    2.0 * lags[1..]
        .iter()
        .map(|lag| (lag / lags[0]).powi(2))
        .sum::<f64>()
}
