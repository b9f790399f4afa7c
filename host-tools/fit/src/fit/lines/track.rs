//! Sines in a recording: their exact frequency and their removal by least squares. Also, sample by sample, the position
//! of the surface under the tool, as the lines of the recording itself give it.
//!
//! A list gives one speed per trial. Where the actual speed wanders, the phase of the strongest line wanders too, and
//! with it all lines of the surface.

use std::f64::consts::TAU;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use nalgebra::{DMatrix, DVector};
use stylus_dsp::fourier::Complex;
use stylus_dsp::sums::rms;
use stylus_dsp::wide;

use super::peaks::{hann, hann_window};

/// Duration over which a line's phase is averaged, s. Faster changes of speed are not followed.
const AVERAGE_S: f64 = 0.2;

/// Least RMS deviation of a line's phase from a straight course for the phase to be followed, rad. A smaller one leaves
/// a residue 34 dB below the line.
const LEAST_WANDER_RAD: f64 = 0.02;

/// Least ratio of the RMS deviation of a line's phase from a straight course to the RMS that noise alone causes, for
/// the phase to be followed. Following the noise would remove it.
const LEAST_WANDER_OVER_NOISE: f64 = 3.0;

/// Least ratio of a line's power to that of the noise next to it, both averaged, for the line's phase to be followed.
const LEAST_RATIO: f64 = 20.0;

/// Relative deviation of a line's amplitude, per radian of its phase deviation, beyond which it counts as two lines
/// that beat.
const MOST_BEAT: f64 = 0.35;

/// Returns the position at each sample at a steady speed, mm; or the phase of a sine at its frequency, turns.
pub(super) fn steady(per_second: f64, samples: usize) -> Vec<f64> {
    let step = per_second / f64::from(SAMPLE_RATE_HZ);
    (0..samples).map(|n| step * n as f64).collect()
}

/// Returns e^{2πi turns(n)} for a sine with these `turns`.
pub(super) fn wave(turns: impl Iterator<Item = f64>) -> Vec<Complex<f64>> {
    turns.map(|turns| Complex::cis(TAU * turns.fract())).collect()
}

/// Returns the wave of a line at each of these positions.
pub(super) fn wave_at(place_mm: &[f64], wavelength_mm: f64) -> Vec<Complex<f64>> {
    wave(place_mm.iter().map(|x| x / wavelength_mm))
}

/// Corrects `place_mm` by the phase of the line of `wavelength_mm`, if this phase wanders and is clear enough. Returns
/// true if the positions were corrected.
pub(super) fn followed(signal: &[f64], place_mm: &mut [f64], wavelength_mm: f64) -> bool {
    let window = ((AVERAGE_S * f64::from(SAMPLE_RATE_HZ)) as usize).min(signal.len() / 4);
    if window < 8 {
        return false;
    }
    let turns = place_mm.iter().map(|place| (place / wavelength_mm).fract());
    let down = signal.iter().zip(turns);
    let down = down.map(|(x, turns)| x * Complex::cis(-TAU * turns));
    let averages = Averages::of(down.collect(), window);
    let Some(phases) = averages.wandering_phases() else {
        return false;
    };
    let corrections = phases.iter().map(|phase| phase / TAU * wavelength_mm);
    let (times, corrections) = (averages.centres(), corrections.collect::<Vec<_>>());
    for (n, place) in place_mm.iter_mut().enumerate() {
        *place += interpolated(&times, &corrections, n as f64);
    }
    true
}

/// A line shifted to 0 Hz, and the overlapping windows over which it is averaged.
struct Averages {
    down: Vec<Complex<f64>>,
    weights: Vec<f64>,
    /// First sample of each window.
    starts: Vec<usize>,
}

impl Averages {
    fn of(down: Vec<Complex<f64>>, window: usize) -> Self {
        let hop = window / 8;
        Self {
            starts: (0..=(down.len() - window) / hop).map(|k| k * hop).collect(),
            weights: (0..window).map(|n| hann(n, window)).collect(),
            down,
        }
    }

    /// Returns the sample in the middle of each window.
    fn centres(&self) -> Vec<f64> {
        let half = self.weights.len() / 2;
        self.starts.iter().map(|&start| (start + half) as f64).collect()
    }

    /// Returns the averages of `turned` over the windows.
    fn of_turned(&self, turned: &[Complex<f64>]) -> Vec<Complex<f64>> {
        let sum = self.weights.iter().sum::<f64>();
        let of_window = |&start: &usize| {
            let terms = turned[start..].iter().zip(&self.weights);
            2.0 / sum * terms.map(|(z, w)| z * *w).sum::<Complex<f64>>()
        };
        self.starts.iter().map(of_window).collect()
    }

    /// Returns the mean power of the averages at a distance of `offset_hz` from the line.
    fn power_at(&self, offset_hz: f64) -> f64 {
        let turns = |n: usize| (offset_hz * n as f64 / f64::from(SAMPLE_RATE_HZ)).fract();
        let turned = self.down.iter().enumerate();
        let turned = turned.map(|(n, z)| z * Complex::cis(-TAU * turns(n)));
        mean_power(&self.of_turned(&turned.collect::<Vec<_>>()))
    }

    /// Returns the phase of each average, rad, continuous. `None` if it is not clear, if it wanders no more than noise
    /// explains, or if it is that of two lines that beat.
    fn wandering_phases(&self) -> Option<Vec<f64>> {
        let phasors = self.of_turned(&self.down);
        let power = mean_power(&phasors);
        // The noise in the same averages next to the line, at the distance that the window separates.
        let offset_hz = 6.0 * f64::from(SAMPLE_RATE_HZ) / self.weights.len() as f64;
        let noise = self.power_at(offset_hz).max(self.power_at(-offset_hz));
        let noise = noise.max(f64::MIN_POSITIVE);
        if power < LEAST_RATIO * noise {
            return None;
        }
        let phases = unwrapped(&phasors);
        let wander = rms(&without_straight_line(&self.centres(), &phases));
        // Half of the noise's power is at right angles to the line's phasor, and turns it.
        // A phase that only noise turns has this RMS.
        let by_noise = (0.5 * noise / power).sqrt();
        if wander < LEAST_WANDER_RAD.max(LEAST_WANDER_OVER_NOISE * by_noise) {
            return None;
        }
        // Two lines close together beat: their phase wanders, and their amplitude equally. A wandering speed does not
        // change the amplitude.
        let lengths: Vec<f64> = phasors.iter().map(|phasor| phasor.norm()).collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let deviations: Vec<f64> = lengths.iter().map(|length| length / mean - 1.0).collect();
        (rms(&deviations) <= MOST_BEAT * wander.min(1.0) + 2.0 * by_noise).then_some(phases)
    }
}

fn mean_power(phasors: &[Complex<f64>]) -> f64 {
    phasors.iter().map(Complex::norm_sqr).sum::<f64>() / phasors.len() as f64
}

fn unwrapped(phasors: &[Complex<f64>]) -> Vec<f64> {
    let mut phase = 0.0;
    let mut last: Option<Complex<f64>> = None;
    phasors
        .iter()
        .map(|phasor| {
            phase = match last {
                Some(last) => phase + (phasor * last.conj()).arg(),
                None => phasor.arg(),
            };
            last = Some(*phasor);
            phase
        })
        .collect()
}

/// Interpolates a table at ascending positions linearly, and extrapolates beyond its ends.
pub(super) fn interpolated(places: &[f64], values: &[f64], at: f64) -> f64 {
    if places.len() < 2 {
        return values.first().copied().unwrap_or(0.0);
    }
    let right = places.partition_point(|&place| place <= at).clamp(1, places.len() - 1);
    let share = (at - places[right - 1]) / (places[right] - places[right - 1]);
    values[right - 1] + share * (values[right] - values[right - 1])
}

pub(super) fn without_straight_line(times: &[f64], values: &[f64]) -> Vec<f64> {
    let count = times.len() as f64;
    let (mean_t, mean_v) = (times.iter().sum::<f64>() / count, values.iter().sum::<f64>() / count);
    let (mut product, mut square) = (0.0, 0.0);
    for (t, v) in times.iter().zip(values) {
        product += (t - mean_t) * (v - mean_v);
        square += (t - mean_t).powi(2);
    }
    let slope = if square > 0.0 { product / square } else { 0.0 };
    let left = times.iter().zip(values);
    left.map(|(t, v)| v - mean_v - slope * (t - mean_t)).collect()
}

/// Returns the samples of `signal` where its ascending `places` are multiples of `step`, by a cubic through four
/// samples. This is exact enough to find a line, which is then fitted to the samples themselves.
pub(super) fn at_even_places(signal: &[f64], places: &[f64], step: f64) -> Vec<f64> {
    let last = signal.len() - 1;
    let at = |index: isize| signal[index.clamp(0, last as isize) as usize];
    let mut before = 0;
    (0..signal.len())
        .map(|n| {
            let place = step * n as f64;
            while before + 2 < places.len() && places[before + 1] <= place {
                before += 1;
            }
            let gap = places[before + 1] - places[before];
            let share = ((place - places[before]) / gap).clamp(-1.0, 2.0);
            let i = before as isize;
            let (a, b, c, d) = (at(i - 1), at(i), at(i + 1), at(i + 2));
            // Catmull and Rom's spline.
            let (first, second) = (0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d);
            let third = 0.5 * (d - a) + 1.5 * (b - c);
            b + share * (first + share * (second + share * third))
        })
        .collect()
}

/// Steps of the search for a sine's frequency. Each divides the error by ten or more.
const REFINEMENTS: usize = 4;

/// Returns the frequency of the sine in `signal` near `frequency_hz`, which is known to `within_hz`, about the width of
/// a cell. It is the maximum of the windowed spectrum.
pub(super) fn refined(signal: &[f64], frequency_hz: f64, within_hz: f64) -> f64 {
    let window = hann_window(signal.len());
    let windowed: Vec<f64> = signal.iter().zip(&*window).map(|(x, w)| w * x).collect();
    let (mut best_hz, mut step_hz) = (frequency_hz, 0.5 * within_hz);
    for _ in 0..REFINEMENTS {
        let level = |hz: f64| spectrum_at(&windowed, hz).norm_sqr().max(f64::MIN_POSITIVE).ln();
        let (before, here, after) = (level(best_hz - step_hz), level(best_hz), level(best_hz + step_hz));
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
    signal.iter().rev().fold(Complex::default(), |sum, x| sum * step + x)
}

/// Number of doubles in an AVX2 register.
const LANES: usize = 4;

/// Returns the complex amplitudes c of the components Re c w(n) that fit `ranges` of `signal` by least squares, m/s².
///
/// `waves` has the w of each component. A ridge of 1e-9 per sample makes components that cannot be distinguished share
/// their amplitude. All amplitudes are 0 if the equations have no solution.
pub(super) fn amplitudes(signal: &[f64], ranges: &[Range<usize>], waves: &[Vec<Complex<f64>>]) -> Vec<Complex<f64>> {
    let count = 2 * waves.len();
    let vectors = count.div_ceil(LANES).max(1);
    // Sums of whole vectors, each in the order of the samples, so that all processors give the same bits.
    let mut row = vec![[0.0; LANES]; vectors];
    // Computed up to the diagonal, in whole vectors; values beyond the diagonal are not read.
    let mut products = vec![[0.0; LANES]; count * vectors];
    let mut right = DVector::<f64>::zeros(count);
    wide(
        #[inline(always)]
        || {
            for n in ranges.iter().cloned().flatten() {
                let x = signal[n];
                for (pair, wave) in row.as_flattened_mut().chunks_exact_mut(2).zip(waves) {
                    (pair[0], pair[1]) = (wave[n].re, -wave[n].im);
                }
                let rows = products.chunks_exact_mut(vectors).zip(right.iter_mut());
                for (i, (sums, right)) in rows.enumerate() {
                    let own = row.as_flattened()[i];
                    *right += own * x;
                    for (sums, values) in sums[..=i / LANES].iter_mut().zip(&row) {
                        for (sum, value) in sums.iter_mut().zip(values) {
                            *sum += own * value;
                        }
                    }
                }
            }
        },
    );
    let product = |i: usize, j: usize| products.as_flattened()[i * vectors * LANES + j];
    solved(signal.len(), product, &right)
}

/// Returns the amplitudes that solve the normal equations of `samples` samples. `product` gives their matrix up to the
/// diagonal. The rows of a component are those of Re w and -Im w.
pub(super) fn solved(samples: usize, product: impl Fn(usize, usize) -> f64, right: &DVector<f64>) -> Vec<Complex<f64>> {
    let count = right.len();
    let mut normal = DMatrix::from_fn(count, count, |i, j| product(i.max(j), i.min(j)));
    for i in 0..count {
        normal[(i, i)] += 1e-9 * samples as f64;
    }
    let Some(solution) = normal.cholesky().map(|factor| factor.solve(right)) else {
        return vec![Complex::default(); count / 2];
    };
    (0..count / 2)
        .map(|i| Complex::new(solution[2 * i], solution[2 * i + 1]))
        .collect()
}

/// Subtracts Re c w(n) from `signal`.
pub(super) fn subtract(signal: &mut [f64], amplitude: Complex<f64>, wave: &[Complex<f64>]) {
    for (x, wave) in signal.iter_mut().zip(wave) {
        *x -= (amplitude * wave).re;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_sine_is_found_to_a_thousandth_of_a_cell_and_removed_to_nothing(
            frequency_hz in 20.0..2200.0_f64,
            off_cells in -0.5..0.5_f64,
            phase in 0.0..1.0_f64,
        ) {
            let samples = 10_000;
            let cell_hz = 0.5;
            let turns = steady(frequency_hz, samples);
            let mut signal: Vec<f64> = turns.iter().map(|t| 3.0 * (TAU * (t + phase)).cos()).collect();
            let found = refined(&signal, frequency_hz + off_cells * cell_hz, cell_hz);
            prop_assert!((found - frequency_hz).abs() < 1e-3 * cell_hz, "{} for {}", found, frequency_hz);
            let wave = wave(steady(found, samples).into_iter());
            let amplitude = amplitudes(&signal, std::slice::from_ref(&(0..samples)), std::slice::from_ref(&wave))[0];
            prop_assert!((amplitude.norm() - 3.0).abs() < 1e-4);
            subtract(&mut signal, amplitude, &wave);
            let left = signal.iter().map(|x| x * x).sum::<f64>() / samples as f64;
            prop_assert!(left < 4.5e-5, "{}", left);
        }
    }

    #[test]
    fn components_that_are_the_same_share_their_amplitude() {
        let turns = steady(100.0, 2000);
        let signal: Vec<f64> = turns.iter().map(|t| (TAU * t).cos()).collect();
        let wave = wave(turns.into_iter());
        let found = amplitudes(&signal, std::slice::from_ref(&(0..2000)), &[wave.clone(), wave]);
        assert!(
            (found[0] + found[1] - Complex::new(1.0, 0.0)).norm() < 1e-3,
            "{found:?}"
        );
        assert!(found.iter().all(|c| c.norm() < 1.0));
    }
}
