//! Amplitudes of the DFT of a whole signal, and their smoothing.

use std::f64::consts::TAU;

use realfft::num_complex::Complex;

use crate::dsp::with_planner;

/// One-sided DFT amplitude |X(k)|, k = 0 ... ⌊N/2⌋, of a signal of any length N, in the signal's unit and without
/// scaling.
///
/// Bin k is at the frequency k · `rate_hz` / N. An empty signal has no bins.
pub fn dft_amplitude(signal: &[f64]) -> Vec<f64> {
    let bins = dft(signal.to_vec());
    // Amplitudes are far from the ends of a double's range, for which the norm's own method takes ten times as long.
    bins.iter().map(|bin| bin.norm_sqr().sqrt()).collect()
}

/// Adds |X(k)|² of a signal to `sums`, as far as both go.
pub(super) fn add_dft_power(signal: Vec<f64>, sums: &mut [f64]) {
    for (sum, bin) in sums.iter_mut().zip(dft(signal)) {
        *sum += bin.norm_sqr();
    }
}

/// Bins X(k), k = 0 ... ⌊N/2⌋; none of an empty signal.
fn dft(mut signal: Vec<f64>) -> Vec<Complex<f64>> {
    if signal.is_empty() {
        return Vec::new();
    }
    let transform = with_planner(|planner| planner.plan_fft_forward(signal.len()));
    let mut output = transform.make_output_vec();
    transform
        .process(&mut signal, &mut output)
        .expect("both buffers have the lengths that the plan asks for");
    output
}

/// Smoothed amplitude S{a}: [`dft_amplitude`] convolved with a Hann kernel of the full width `width_hz`, zero to zero.
///
/// At 0 Hz and at half the sample rate the kernel is truncated and normalised again, so that a flat spectrum stays
/// flat. A width of at most two bins is no smoothing. The work is proportional to N² · `width_hz` / `rate_hz`.
pub fn smoothed_amplitude(signal: &[f64], rate_hz: f64, width_hz: f64) -> Vec<f64> {
    smooth(
        &dft_amplitude(signal),
        rate_hz / signal.len() as f64,
        width_hz,
    )
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
        let sum: f64 = left
            .chain(right)
            .map(|(value, weight)| value * weight)
            .sum();
        let weights =
            tail_sums[before.len().min(tail.len())] + tail_sums[after.len().min(tail.len())];
        (values[centre] + sum) / (1.0 + weights)
    };
    (0..values.len()).map(mean_around).collect()
}

/// Returns the weights of a Hann kernel of full width `width` steps at 1, 2, ... steps from its centre, whose weight is
/// one; at most `most` of them.
pub(super) fn hann_tail(width: f64, most: usize) -> Vec<f64> {
    (1..=most)
        .map(|offset| offset as f64)
        .take_while(|offset| offset < &(width / 2.0))
        .map(|offset| 0.5 + 0.5 * (TAU * offset / width).cos())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close, noise};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_dft_keeps_the_energy_at_any_length(len in 1usize..600, seed: u64) {
            let signal = noise(len, seed);
            let amplitude = dft_amplitude(&signal);
            prop_assert_eq!(amplitude.len(), len / 2 + 1);
            // Every bin but those at 0 Hz and at half the rate stands for itself and its mirror image.
            let mirrored = |bin: usize| if bin == 0 || 2 * bin == len { 1.0 } else { 2.0 };
            let energy: f64 = amplitude.iter().enumerate().map(|(bin, x)| mirrored(bin) * x * x).sum();
            let expected: f64 = signal.iter().map(|x| x * x).sum();
            prop_assert!(close(energy / len as f64, expected, 1e-12));
        }

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

        #[test]
        fn smoothing_stays_between_the_extremes(seed: u64, width_hz in 0.0..10_000.0f64) {
            let amplitude = dft_amplitude(&noise(301, seed));
            let (low, high) = amplitude.iter().fold((f64::MAX, 0.0f64), |(low, high), &x| (low.min(x), high.max(x)));
            for smoothed in smooth(&amplitude, RATE_HZ / 301.0, width_hz) {
                prop_assert!(smoothed > low * (1.0 - 1e-12) && smoothed < high * (1.0 + 1e-12));
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
        // Hann falls to half a quarter of its width from the centre.
        assert!(close(smoothed[500 + 10], smoothed[500] / 2.0, 1e-12));
        assert!(close(smoothed.iter().sum(), 1.0, 1e-12));
        assert_eq!(smooth(&line, 0.5, 0.0), line);
        assert!(
            smooth(&line, 0.5, f64::INFINITY)
                .iter()
                .all(|x| close(*x, 1.0 / 1001.0, 1e-12))
        );
    }
}
