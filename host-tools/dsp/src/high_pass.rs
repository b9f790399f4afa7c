//! A high-pass filter that removes the motion of a hand or rig.
//!
//! A hand that holds the tool drifts below about 10 Hz, often more strongly than the texture vibrates, and in another
//! direction. Unless this motion is removed, it determines the principal axis, the level and the model's lowest bands.

use std::f64::consts::TAU;

use crate::spectrum::PowerSpectrum;
use crate::sums::{mean, sum, variance};

/// Frequency below which power counts as the motion of a hand or rig, Hz.
pub const SLOW_HZ: f64 = 10.0;

/// The lowest frequency at which a filtered recording is valid, as a multiple of the cut-off frequency.
const LOWEST_OVER_CUT: f64 = 1.25;

/// Quality factors of the two sections of a Butterworth filter of order 4.
const QUALITY: [f64; 2] = [0.541_196_100_146_197, 1.306_562_964_876_377];

/// Length of the extrapolation of a signal beyond its ends, in periods of the cut-off frequency.
const CONTINUATION_PERIODS: f64 = 3.0;

/// Rate of the means from which slow motion is computed, Hz. At [`SLOW_HZ`] a mean over a period of it loses 0.04 dB.
const MEANS_HZ: f64 = 200.0;

/// Returns the fraction of the power of `axes`, about their means, that is below [`SLOW_HZ`]; 0 without power. The
/// spectra use segments of 1 s, or shorter ones for a shorter recording.
pub fn slow_share(axes: &[Vec<f64>], rate_hz: f64) -> f64 {
    let (mut slow, mut all) = (0.0, 0.0);
    let group = ((rate_hz / MEANS_HZ) as usize).max(1);
    for axis in axes {
        let mean = mean(axis);
        let means = axis.chunks_exact(group).map(|part| sum(part) / group as f64 - mean);
        let means: Vec<f64> = means.collect();
        let spectrum = PowerSpectrum::welch(&means, rate_hz / group as f64);
        slow += spectrum.power_between(0.0, SLOW_HZ);
        // The rest of the variance is within the groups.
        let within = variance(axis) - variance(&means);
        all += spectrum.power_between(0.0, 0.5 * rate_hz) + within.max(0.0);
    }
    if all > 0.0 { slow / all } else { 0.0 }
}

/// Lowest valid frequency of a recording after a high-pass at `cut_hz`, Hz.
pub fn lowest_hz(cut_hz: f64) -> f64 {
    LOWEST_OVER_CUT * cut_hz
}

/// Filters `signal` at `rate_hz` in place by a Butterworth high-pass of order 4 at `cut_hz`, forwards and backwards, so
/// that the phase does not change. The attenuation is 6 dB at `cut_hz` and 1.3 dB at [`lowest_hz`]. Beyond each end,
/// the signal is extrapolated by its point reflection about that end, so that a drift still under way there makes no
/// step.
pub fn high_pass(signal: &mut [f64], rate_hz: f64, cut_hz: f64) {
    let [first, .., last] = *signal else {
        signal.fill(0.0);
        return;
    };
    let wanted = (CONTINUATION_PERIODS * rate_hz / cut_hz) as usize;
    // A point reflection has no more samples than the signal beside its end.
    let count = wanted.min(signal.len() - 1);
    let before = signal[1..=count].iter().rev().map(|x| 2.0 * first - x);
    let after = signal.iter().rev().skip(1).take(count).map(|x| 2.0 * last - x);
    let mut long: Vec<f64> = before.chain(signal.iter().copied()).chain(after).collect();
    for _ in 0..2 {
        // A constant is filtered to zero. So the first value can be subtracted, and the filter starts at rest.
        let begin = long[0];
        long.iter_mut().for_each(|x| *x -= begin);
        for quality in QUALITY {
            section(&mut long, rate_hz, cut_hz, quality);
        }
        long.reverse();
    }
    signal.copy_from_slice(&long[count..count + signal.len()]);
}

/// Filters `signal` in place by a high-pass section of order 2, from rest. The bilinear transform is prewarped so that
/// `cut_hz` stays the same.
fn section(signal: &mut [f64], rate_hz: f64, cut_hz: f64, quality: f64) {
    let (sin, cos) = (TAU * cut_hz / rate_hz).sin_cos();
    let alpha = sin / (2.0 * quality);
    let scale = 1.0 / (1.0 + alpha);
    let b = 0.5 * (1.0 + cos) * scale;
    let (a1, a2) = (-2.0 * cos * scale, (1.0 - alpha) * scale);
    let (mut first, mut second) = (0.0, 0.0);
    for x in signal {
        let y = b * *x + first;
        first = second - 2.0 * b * *x - a1 * y;
        second = b * *x - a2 * y;
        *x = y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 5000.0;

    fn sine(frequency_hz: f64, count: usize) -> Vec<f64> {
        let angle = TAU * frequency_hz / RATE_HZ;
        (0..count).map(|n| (angle * n as f64 + 0.3).sin()).collect()
    }

    /// Reference: the formula of the analogue filter with warped frequencies, |H|² = 1/(1 + (tan c / tan w)⁸), applied
    /// twice.
    #[test]
    fn gain_is_that_of_a_butterworth_filter_of_order_4_applied_twice_without_a_shift_of_phase() {
        let warped = |hz: f64| (std::f64::consts::PI * hz / RATE_HZ).tan();
        for hz in [4.0, 8.0, 20.0, 25.0, 40.0, 700.0, 2400.0] {
            let (before, mut after) = (sine(hz, 20_000), sine(hz, 20_000));
            high_pass(&mut after, RATE_HZ, 20.0);
            let expected = 1.0 / (1.0 + (warped(20.0) / warped(hz)).powi(8));
            let worst = (5_000..15_000)
                .map(|n| (after[n] - expected * before[n]).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-3 * expected + 1e-6, "{hz} Hz: {worst}");
        }
    }

    #[test]
    fn a_drift_that_ends_in_mid_air_leaves_nothing_at_the_ends() {
        let drift: Vec<f64> = (0..10_000).map(|n| 1e-3 * f64::from(n) + 3.0).collect();
        for count in [10_000, 2_000, 400] {
            let mut left = drift[..count].to_vec();
            high_pass(&mut left, RATE_HZ, 20.0);
            let most = left.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            assert!(most < 1e-3, "{count}: {most}");
        }
        for count in 0..3 {
            high_pass(&mut drift[..count].to_vec(), RATE_HZ, 20.0);
        }
    }
}
