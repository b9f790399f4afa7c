//! Sines in a recording: their exact frequency, and their removal by least squares.

use std::f64::consts::TAU;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use nalgebra::{DMatrix, DVector};
use realfft::num_complex::Complex;

use super::peaks::hann;

/// Steps of the search for a sine's frequency; each divides the error by ten or more.
const REFINEMENTS: usize = 4;

/// Frequency of the sine in `signal` near `frequency_hz`, known to `within_hz`, about the width of a cell: the maximum
/// of the windowed spectrum.
pub(super) fn refined(signal: &[f64], frequency_hz: f64, within_hz: f64) -> f64 {
    let windowed: Vec<f64> = signal
        .iter()
        .enumerate()
        .map(|(n, x)| hann(n, signal.len()) * x)
        .collect();
    let (mut best_hz, mut step_hz) = (frequency_hz, 0.5 * within_hz);
    for _ in 0..REFINEMENTS {
        let level = |hz: f64| {
            spectrum_at(&windowed, hz)
                .norm_sqr()
                .max(f64::MIN_POSITIVE)
                .ln()
        };
        let (before, here, after) = (
            level(best_hz - step_hz),
            level(best_hz),
            level(best_hz + step_hz),
        );
        let curvature = before - 2.0 * here + after;
        let shift = if curvature < 0.0 {
            (0.5 * (before - after) / curvature).clamp(-1.0, 1.0)
        } else {
            (after - before).signum()
        };
        best_hz += shift * step_hz;
        step_hz *= 0.4;
    }
    best_hz.clamp(frequency_hz - within_hz, frequency_hz + within_hz)
}

/// Σ x(n) e^{-2πi f n / fs}.
fn spectrum_at(signal: &[f64], frequency_hz: f64) -> Complex<f64> {
    let step = Complex::cis(-TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ));
    // Horner's scheme from the end.
    signal
        .iter()
        .rev()
        .fold(Complex::default(), |sum, x| sum * step + x)
}

/// Complex amplitudes c of the components Re c e^{2πi turns(n)} that leave the least squares in `ranges` of
/// `signal`, m/s².
///
/// `turns` has the phase of each component at each sample. Components that cannot be told apart share their amplitude
/// by a ridge of 1e-9 of their power.
pub(super) fn amplitudes(
    signal: &[f64],
    ranges: &[Range<usize>],
    turns: &[Vec<f64>],
) -> Vec<Complex<f64>> {
    let count = 2 * turns.len();
    let (mut normal, mut right) = (
        DMatrix::<f64>::zeros(count, count),
        DVector::<f64>::zeros(count),
    );
    let mut row = vec![0.0; count];
    for n in ranges.iter().cloned().flatten() {
        let x = signal[n];
        for (component, turns) in turns.iter().enumerate() {
            let (sine, cosine) = (TAU * turns[n].fract()).sin_cos();
            (row[2 * component], row[2 * component + 1]) = (cosine, -sine);
        }
        for i in 0..count {
            right[i] += row[i] * x;
            for j in 0..=i {
                normal[(i, j)] += row[i] * row[j];
            }
        }
    }
    for i in 0..count {
        normal[(i, i)] += 1e-9 * signal.len() as f64;
        for j in 0..i {
            normal[(j, i)] = normal[(i, j)];
        }
    }
    let Some(solution) = normal.cholesky().map(|factor| factor.solve(&right)) else {
        return vec![Complex::default(); turns.len()];
    };
    (0..turns.len())
        .map(|i| Complex::new(solution[2 * i], solution[2 * i + 1]))
        .collect()
}

/// Subtracts Re c e^{2πi turns(n)} from `signal`.
pub(super) fn subtract(signal: &mut [f64], amplitude: Complex<f64>, turns: &[f64]) {
    for (x, turns) in signal.iter_mut().zip(turns) {
        *x -= (amplitude * Complex::cis(TAU * turns.fract())).re;
    }
}

/// Phase of a sine of constant frequency at each of `samples` samples, turns.
pub(super) fn steady_turns(frequency_hz: f64, samples: usize) -> Vec<f64> {
    let step = frequency_hz / f64::from(SAMPLE_RATE_HZ);
    (0..samples).map(|n| step * n as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_sine_is_found_to_a_thousandth_of_a_cell_and_removed_to_nothing(
            frequency_hz in 20.0..2200.0_f64,
            off_cells in -0.5..0.5_f64,
            phase in 0.0..1.0_f64,
        ) {
            let samples = 10_000;
            let cell_hz = 0.5;
            let turns = steady_turns(frequency_hz, samples);
            let mut signal: Vec<f64> = turns.iter().map(|t| 3.0 * (TAU * (t + phase)).cos()).collect();
            let found = refined(&signal, frequency_hz + off_cells * cell_hz, cell_hz);
            prop_assert!((found - frequency_hz).abs() < 1e-3 * cell_hz, "{} for {}", found, frequency_hz);
            let turns = steady_turns(found, samples);
            let amplitude = amplitudes(&signal, std::slice::from_ref(&(0..samples)), std::slice::from_ref(&turns))[0];
            prop_assert!((amplitude.norm() - 3.0).abs() < 1e-4);
            subtract(&mut signal, amplitude, &turns);
            let left = signal.iter().map(|x| x * x).sum::<f64>() / samples as f64;
            prop_assert!(left < 4.5e-5, "{}", left);
        }
    }

    #[test]
    fn components_that_are_the_same_share_their_amplitude() {
        let turns = steady_turns(100.0, 2000);
        let signal: Vec<f64> = turns.iter().map(|t| (TAU * t).cos()).collect();
        let found = amplitudes(
            &signal,
            std::slice::from_ref(&(0..2000)),
            &[turns.clone(), turns],
        );
        assert!(
            (found[0] + found[1] - Complex::new(1.0, 0.0)).norm() < 1e-3,
            "{found:?}"
        );
        assert!(found.iter().all(|c| c.norm() < 1.0));
    }
}
