//! Amplitudes of the DFT of a whole signal, their smoothing, and the paper's cost, equation (6).

use std::f64::consts::{PI, TAU};

use crate::fourier::{self, Complex};

/// Default full width of the Hann kernel that smooths amplitudes, Hz. The paper does not state its width.
pub const DEFAULT_SMOOTHING_WIDTH_HZ: f64 = 20.0;

/// Returns the one-sided DFT amplitude |X(k)|, k = 0 ... ⌊N/2⌋, of a signal of any length N, in the signal's unit and
/// without scaling.
///
/// Bin k is at the frequency k · `rate_hz` / N. An empty signal has no bins.
pub fn dft_amplitude(signal: &[f64]) -> Vec<f64> {
    let bins = dft(signal.to_vec());
    // Amplitudes are far from the limits of a double's range. The `norm` method, which covers that range, takes ten
    // times as long.
    bins.iter().map(|bin| bin.norm_sqr().sqrt()).collect()
}

/// Adds |X(k)|² of a signal to `sums`, up to the end of the shorter one.
pub(super) fn add_dft_power(signal: Vec<f64>, sums: &mut [f64]) {
    for (sum, bin) in sums.iter_mut().zip(dft(signal)) {
        *sum += bin.norm_sqr();
    }
}

/// Returns the bins X(k), k = 0 ... ⌊N/2⌋; an empty signal has none.
fn dft(mut signal: Vec<f64>) -> Vec<Complex<f64>> {
    if signal.is_empty() {
        return Vec::new();
    }
    fourier::forward(&mut signal)
}

/// Returns the smoothed amplitude S{a}: [`dft_amplitude`] convolved with a Hann kernel of the full width `width_hz`,
/// from zero to zero.
///
/// At 0 Hz and at half the sample rate the kernel is truncated and normalised again, so that a flat spectrum stays
/// flat. A width of at most two bins does not smooth. The computing time is proportional to N² · `width_hz` /
/// `rate_hz`.
pub fn smoothed_amplitude(signal: &[f64], rate_hz: f64, width_hz: f64) -> Vec<f64> {
    smooth(&dft_amplitude(signal), rate_hz / signal.len() as f64, width_hz)
}

/// Convolves values that are `step_hz` apart with a Hann kernel of full width `width_hz`, normalised again at both
/// ends.
fn smooth(values: &[f64], step_hz: f64, width_hz: f64) -> Vec<f64> {
    let tail = hann_tail(width_hz / step_hz, values.len());
    // tail_sums[n] is the sum of the first n weights.
    let tail_sums: Vec<f64> = std::iter::once(0.0)
        .chain(tail.iter().scan(0.0, |sum, weight| {
            *sum += weight;
            Some(*sum)
        }))
        .collect();
    let mean_around = |centre: usize| {
        let (before, after) = (&values[..centre], &values[centre + 1..]);
        let left = before.iter().rev().zip(&tail);
        let right = after.iter().zip(&tail);
        let sum: f64 = left.chain(right).map(|(value, weight)| value * weight).sum();
        let weights = tail_sums[before.len().min(tail.len())] + tail_sums[after.len().min(tail.len())];
        (values[centre] + sum) / (1.0 + weights)
    };
    (0..values.len()).map(mean_around).collect()
}

/// Returns the weights of a Hann kernel of full width `width` steps, at 1, 2, ... steps from its centre. The weight at
/// the centre is one. At most `most` weights are returned.
fn hann_tail(width: f64, most: usize) -> Vec<f64> {
    (1..=most)
        .map(|offset| offset as f64)
        .take_while(|offset| offset < &(width / 2.0))
        .map(|offset| 0.5 + 0.5 * (TAU * offset / width).cos())
        .collect()
}

/// Returns the paper's cost, equation (6): C = RMS(S{a} - S{a_g}) / RMS(S{a}), over all frequencies from 0 to half the
/// sample rate.
///
/// S is [`smoothed_amplitude`]. The end of the longer signal is cut off, because amplitudes of signals of different
/// lengths cannot be compared. The cost between two independent excerpts of the same noise is not zero: see
/// [`expected_cost_of_blocks`].
///
/// Returns `None` if a signal is empty, if the recorded one is silent, or if a value is not finite.
pub fn spectral_cost(recorded: &[f64], synthesised: &[f64], rate_hz: f64, width_hz: f64) -> Option<f64> {
    cost_of_blocks(&[recorded], &[synthesised], rate_hz, width_hz, (0.0, rate_hz / 2.0))
}

/// Like [`spectral_cost`], for signals in blocks, over the frequencies from `low_hz` to `high_hz`. S is the mean of the
/// blocks' smoothed amplitudes, and no transform crosses the join of two blocks.
///
/// All blocks are cut to the length of the shortest. Equal numbers of blocks of both signals are used, because a mean
/// of fewer amplitudes scatters more.
pub fn cost_of_blocks(
    recorded: &[&[f64]],
    synthesised: &[&[f64]],
    rate_hz: f64,
    width_hz: f64,
    (low_hz, high_hz): (f64, f64),
) -> Option<f64> {
    let count = recorded.len().min(synthesised.len());
    let (recorded, synthesised) = (&recorded[..count], &synthesised[..count]);
    let len = recorded.iter().chain(synthesised).map(|b| b.len()).min()?;
    let reference = mean_amplitude(recorded, len, rate_hz, width_hz);
    let other = mean_amplitude(synthesised, len, rate_hz, width_hz);
    let step_hz = rate_hz / len as f64;
    let (mut difference, mut energy) = (0.0, 0.0);
    for (bin, (a, b)) in reference.iter().zip(&other).enumerate() {
        let frequency_hz = bin as f64 * step_hz;
        if frequency_hz >= low_hz && frequency_hz <= high_hz {
            difference += (a - b).powi(2);
            energy += a * a;
        }
    }
    Some((difference / energy).sqrt()).filter(|cost| cost.is_finite())
}

/// Returns the mean of the smoothed amplitudes of the blocks, each cut to `len` samples.
fn mean_amplitude(blocks: &[&[f64]], len: usize, rate_hz: f64, width_hz: f64) -> Vec<f64> {
    let mut mean = vec![0.0; len / 2 + 1];
    for block in blocks {
        for (sum, value) in mean
            .iter_mut()
            .zip(smoothed_amplitude(&block[..len], rate_hz, width_hz))
        {
            *sum += value / blocks.len() as f64;
        }
    }
    mean
}

/// Returns the approximate [`cost_of_blocks`] between two independent excerpts of the same Gaussian noise with a broad
/// spectrum. Each excerpt has `count` blocks of `len` samples. A perfect model has this cost, because it does not copy
/// the recording.
///
/// Amplitudes of Gaussian noise are Rayleigh distributed, with a variance of 4/π - 1 times their squared mean.
/// Smoothing with weights w divides the variance by (Σw)²/Σw², and averaging over the blocks divides it by their
/// number. The difference of two amplitudes has twice the variance.
pub fn expected_cost_of_blocks(count: usize, len: usize, rate_hz: f64, width_hz: f64) -> f64 {
    let tail = hann_tail(width_hz * len as f64 / rate_hz, len / 2);
    let sum = 1.0 + 2.0 * tail.iter().sum::<f64>();
    let squares = 1.0 + 2.0 * tail.iter().map(|weight| weight * weight).sum::<f64>();
    let variance = (4.0 / PI - 1.0) * squares / (sum * sum) / count.max(1) as f64;
    (2.0 * variance / (1.0 + variance)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close, scaled};
    use super::*;
    use proptest::prelude::*;
    use test_helpers::noise;

    proptest! {
        #[test]
        fn smoothing_leaves_a_flat_spectrum_flat(
            len in 1usize..600, width_hz in 0.0..10_000.0f64, level in 1e-3..1e3f64,
        ) {
            // An impulse has the same amplitude everywhere.
            let mut signal = vec![0.0; len];
            signal[len / 3] = level;
            for amplitude in smoothed_amplitude(&signal, RATE_HZ, width_hz) {
                prop_assert!(close(amplitude, level, 1e-12));
            }
        }

    }

    #[test]
    fn smoothing_spreads_a_line_over_the_width_asked_for() {
        let mut line = vec![0.0; 1001];
        line[500] = 1.0;
        let smoothed = smooth(&line, 0.5, 20.0);
        assert!(smoothed[500 - 19] > 0.0 && smoothed[500 + 19] > 0.0);
        assert!(smoothed[500 - 20] <= 0.0 && smoothed[500 + 20] <= 0.0);
        // A Hann kernel falls to half its peak at a quarter of its width from the centre.
        assert!(close(smoothed[500 + 10], smoothed[500] / 2.0, 1e-12));
        assert!(close(smoothed.iter().sum(), 1.0, 1e-12));
        assert_eq!(smooth(&line, 0.5, 0.0), line);
        assert!(
            smooth(&line, 0.5, f64::INFINITY)
                .iter()
                .all(|x| close(*x, 1.0 / 1001.0, 1e-12))
        );
    }

    proptest! {
        #[test]
        fn a_scaled_copy_costs_what_it_is_scaled_by(
            len in 2usize..600, seed: u64, change in -3.0..3.0f64, width_hz in 0.0..200.0f64,
        ) {
            let signal = noise(seed, len);
            let cost = spectral_cost(&signal, &scaled(&signal, 1.0 + change), RATE_HZ, width_hz).unwrap();
            prop_assert!((cost - change.abs().min((2.0 + change).abs())).abs() < 1e-9);
        }

    }

    #[test]
    fn noise_in_blocks_costs_what_statistics_expect_and_nothing_outside_the_range_counts() {
        let mut mean = 0.0;
        for pair in 0..20 {
            let (a, b) = (noise(900 + pair, 10_000), noise(950 + pair, 10_000));
            let (a, b): (Vec<&[f64]>, Vec<&[f64]>) = (a.chunks(2500).collect(), b.chunks(2500).collect());
            mean += cost_of_blocks(&a, &b, RATE_HZ, 20.0, (2.0, 2500.0)).unwrap() / 20.0;
        }
        let expected = expected_cost_of_blocks(4, 2500, RATE_HZ, 20.0);
        assert!(close(mean, expected, 0.05), "{mean}, expected {expected}");
        let a = noise(7, 10_000);
        let tone = super::super::test_signals::sine(10_000, 1500.0, 30.0);
        let with_tone: Vec<f64> = a.iter().zip(&tone).map(|(a, tone)| a + tone).collect();
        let below = |high_hz| cost_of_blocks(&[&a], &[&with_tone], RATE_HZ, 20.0, (0.0, high_hz));
        assert!(below(1000.0).unwrap() < 0.01 && below(2500.0).unwrap() > 1.0);
    }

    #[test]
    fn a_cost_that_does_not_exist_is_none() {
        let signal = noise(1, 1000);
        assert_eq!(spectral_cost(&[0.0; 1000], &signal, RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&[], &signal, RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&signal, &[], RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&[f64::NAN; 1000], &signal, RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&signal, &[f64::INFINITY; 1000], RATE_HZ, 20.0), None);
    }
}
