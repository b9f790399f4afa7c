//! Kurtosis of the prediction error within short windows: impulses, apart from the level's slower changes.

use super::level::window_samples;
use super::moments;
use super::values::{mean_square, median};
use crate::dsp::autocorrelation::Autocorrelation;
use crate::dsp::linear_prediction::{Prediction, corrected, step_up};

/// Highest order of the predictor. Textures are white enough from there on.
const ORDER: usize = 100;

/// Samples per coefficient that a predictor is estimated from, at least.
const SAMPLES_PER_COEFFICIENT: usize = 20;

/// Share of the signal's power below which a prediction error is the round-off of lines and not a residual.
const LEAST_ERROR: f64 = 1e-7;

/// Median over windows of 50 ms of the kurtosis about each window's mean; `None` if no block holds a window after the
/// predictor's order, or nothing is left of the signal.
pub(super) fn kurtosis(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let residual = residual(blocks);
    let window = window_samples(rate_hz)?;
    let of_window = |window: &[f64]| {
        let mean = window.iter().sum::<f64>() / window.len() as f64;
        let centred: Vec<f64> = window.iter().map(|x| x - mean).collect();
        moments::kurtosis(centred.iter())
    };
    let windows = residual.iter().flat_map(|block| block.chunks_exact(window));
    median(windows.filter_map(of_window))
}

/// Prediction error of each block, without the samples whose past is not in the block; empty where there is none.
fn residual(blocks: &[&[f64]]) -> Vec<Vec<f64>> {
    let count: usize = blocks.iter().map(|block| block.len()).sum();
    let order = ORDER.min(count / SAMPLES_PER_COEFFICIENT);
    let mut lags = vec![0.0; order + 1];
    for block in blocks.iter().filter(|block| block.len() > order) {
        let own = Autocorrelation::of(block, order).lags;
        for (sum, lag) in lags.iter_mut().zip(own) {
            *sum += lag * block.len() as f64;
        }
    }
    let prediction = Prediction::levinson_durbin(&corrected(lags), order);
    let a = step_up(&prediction.reflection);
    let predict = |block: &&[f64]| -> Vec<f64> {
        let ends = a.len()..block.len().max(a.len());
        ends.map(|n| {
            let past = block[n - a.len()..n].iter().rev();
            block[n] + a.iter().zip(past).map(|(a, x)| a * x).sum::<f64>()
        })
        .collect()
    };
    let residual: Vec<Vec<f64>> = blocks.iter().map(predict).collect();
    let left = residual.iter().map(Vec::len).sum();
    let power = mean_square(blocks.iter().copied().flatten(), count);
    if mean_square(residual.iter().flatten(), left) > LEAST_ERROR * power {
        residual
    } else {
        Vec::new()
    }
}
