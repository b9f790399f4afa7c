//! Phase correlation, which tells a copy of a signal from another signal of the same spectrum.

use std::f64::consts::PI;

use crate::dsp::with_planner;

/// Returns the largest magnitude, over all shifts, of the phase correlation of two signals: the inverse transform of
/// their cross spectrum with all amplitudes set to one (Knapp and Carter, IEEE Trans. ASSP 24, 1976, 320: PHAT).
///
/// It is 1 for a signal and itself, also scaled, inverted or shifted in a circle, and about √(2 ln N / N) for
/// independent signals of N samples, whatever their spectrum. A cut that shares a part of the samples comes between.
/// Bins more than 100 dB below the strongest do not count, because their phase is round-off.
pub fn phase_correlation(a: &[f64], b: &[f64]) -> f64 {
    let len = a.len().max(b.len());
    if a.is_empty() || b.is_empty() {
        return 0.0;
    }
    let (forward, inverse) =
        with_planner(|planner| (planner.plan_fft_forward(len), planner.plan_fft_inverse(len)));
    let transformed = |signal: &[f64]| {
        let mut padded = tapered(signal);
        padded.resize(len, 0.0);
        let mut bins = forward.make_output_vec();
        forward
            .process(&mut padded, &mut bins)
            .expect("lengths come from the plan");
        bins
    };
    let mut cross = transformed(a);
    for (a, b) in cross.iter_mut().zip(transformed(b)) {
        *a *= b.conj();
    }
    let strongest = cross.iter().map(|bin| bin.norm()).fold(0.0, f64::max);
    // Amplitudes of the cross spectrum are squares, so that 100 dB are ten decades.
    let least = 1e-10 * strongest;
    let mut weight = 0.0;
    for (index, bin) in cross.iter_mut().enumerate() {
        let amplitude = bin.norm();
        let is_edge = index == 0 || 2 * index == len;
        if amplitude > least && !is_edge {
            *bin /= amplitude;
            weight += 2.0;
        } else {
            *bin *= 0.0;
        }
    }
    if weight <= 0.0 {
        return 0.0;
    }
    let mut correlation = inverse.make_output_vec();
    inverse
        .process(&mut cross, &mut correlation)
        .expect("lengths come from the plan, and edges are zero");
    let highest = correlation.iter().map(|x| x.abs()).fold(0.0, f64::max);
    highest / weight
}

/// `signal` with a twentieth at each end faded, because the step between end and beginning of any two signals of much
/// low frequency has one phase.
fn tapered(signal: &[f64]) -> Vec<f64> {
    let mut faded = signal.to_vec();
    let (len, ramp) = (signal.len(), signal.len() / 20);
    for n in 0..ramp {
        let weight = 0.5 - 0.5 * (PI * (n as f64 + 0.5) / ramp as f64).cos();
        faded[n] *= weight;
        faded[len - 1 - n] *= weight;
    }
    faded
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Noise whose power falls by 12 dB per octave.
    fn red(seed: u64, len: usize) -> Vec<f64> {
        let generator = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut state = (0.0, 0.0);
        StandardNormal
            .sample_iter(generator)
            .take(len)
            .map(|e: f64| {
                state.0 = 0.95 * state.0 + e;
                state.1 = 0.95 * state.1 + state.0;
                state.1
            })
            .collect()
    }

    #[test]
    fn copies_scaled_inverted_shifted_or_rounded_correlate_and_other_takes_do_not() {
        let a = red(1, 10_000);
        assert!((phase_correlation(&a, &a) - 1.0).abs() < 1e-9);
        let scaled: Vec<f64> = a.iter().map(|x| -0.3 * x).collect();
        assert!(phase_correlation(&a, &scaled) > 0.999);
        assert!(phase_correlation(&a, &a[200..]) > 0.8);
        let rounded: Vec<f64> = a.iter().map(|x| (x * 50.0).round() / 50.0).collect();
        assert!(phase_correlation(&a, &rounded) > 0.9);
        assert!(phase_correlation(&a, &a[5000..]) > 0.5);
        for seed in 2..12 {
            assert!(phase_correlation(&a, &red(seed, 10_000)) < 0.1, "{seed}");
            assert!(phase_correlation(&a, &red(seed, 8000)) < 0.1, "{seed}");
        }
    }

    #[test]
    fn silence_is_a_copy_of_nothing() {
        assert_eq!(phase_correlation(&[], &[1.0]).to_bits(), 0);
        assert_eq!(phase_correlation(&[0.0; 100], &red(1, 100)).to_bits(), 0);
    }
}
