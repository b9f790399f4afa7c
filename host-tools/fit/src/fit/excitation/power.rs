//! Power of a residual: overall, and around each sample.

use stylus_dsp::sums::{mean_square, sliding};

/// Least power of a residual's level, relative to its mean power: -50 dB, so that nothing is divided by zero.
const LEAST_POWER: f64 = 1e-5;

/// Returns the weights of a Hann window of `smoothing` samples.
fn hann(smoothing: usize) -> Vec<f64> {
    let reach = smoothing / 2;
    let weight = |offset: usize| {
        // The window is 0 at the first offset beyond its reach.
        let angle = std::f64::consts::PI * offset as f64 / (reach + 1) as f64;
        0.5 * (1.0 + angle.cos())
    };
    (0..=2 * reach).map(|n| weight(n.abs_diff(reach))).collect()
}

/// Returns the least power of a level of `residual`.
fn least_power(residual: &[f64]) -> f64 {
    (LEAST_POWER * mean_square(residual)).max(f64::MIN_POSITIVE)
}

/// Returns the RMS of `residual` around each of its samples, weighted by a Hann window of `smoothing` samples. At the
/// ends, only the part of the window within the residual counts.
pub(super) fn local_rms(residual: &[f64], smoothing: usize) -> Vec<f64> {
    let weights = hann(smoothing);
    let (reach, least) = (weights.len() / 2, least_power(residual));
    let mut padded = vec![0.0; residual.len() + 2 * reach];
    for (out, x) in padded[reach..].iter_mut().zip(residual) {
        *out = x * x;
    }
    let whole: f64 = weights.iter().sum();
    let weight = |n: usize| {
        let (before, after) = (n.min(reach), (residual.len() - 1 - n).min(reach));
        if before + after == 2 * reach {
            whole
        } else {
            weights[reach - before..=reach + after].iter().sum()
        }
    };
    let level = |(n, sum): (usize, f64)| (sum / weight(n)).max(least).sqrt();
    let sums = sliding(&padded, &weights);
    (sums.into_iter().enumerate().take(residual.len())).map(level).collect()
}
