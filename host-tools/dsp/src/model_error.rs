//! Difference between the spectra of a model before and after rounding, in the range of frequencies that skin feels.

use serde::{Deserialize, Serialize};

use super::fourier::{self, Complex};
use super::linear_prediction::{error_share, step_up};
use super::spectrum::{BAND_COUNT, band_edges_hz};

/// Range of frequencies in which the spectra are compared, Hz.
const RANGE_HZ: (f64, f64) = (20.0, 1000.0);

/// Largest step between the frequencies that are compared, Hz.
const WIDEST_STEP_HZ: f64 = 0.31;

/// Number of steps from a peak within which the density must fall by half for the peak to be a line. Wider peaks are
/// resolved by the steps.
const LINE_STEPS: usize = 4;

/// Largest differences between the spectra of two models of equal power, 20 to 1000 Hz.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelError {
    /// RMS difference over linear frequency, dB.
    pub rms_db: f64,
    /// Difference of the power in the third octave in which it is largest, dB.
    pub third_octave_db: f64,
    /// Largest difference of the density at the peak of a line, dB; 0 without lines. A peak is a line if the density
    /// falls by half within 1.2 Hz.
    pub line_db: f64,
}

impl ModelError {
    /// Compares the model with the reflection coefficients `rounded` with the model `exact`, at a sample rate of
    /// `rate_hz`.
    pub fn between(exact: &[f64], rounded: &[f64], rate_hz: f64) -> Self {
        let length = ((rate_hz / WIDEST_STEP_HZ).ceil() as usize).next_power_of_two();
        let step_hz = rate_hz / length as f64;
        let models = [exact, rounded].map(Polynomial::of);
        let highest_hz = RANGE_HZ.1.max(band_edges_hz(BAND_COUNT - 1).1);
        let bins = (highest_hz / step_hz).ceil() as usize + LINE_STEPS + 1;
        let [exact_density, ratio] = densities(&models, length, bins);
        let bin = |hz: f64| ((hz / step_hz).ceil() as usize).min(ratio.len());
        let range = bin(RANGE_HZ.0)..bin(RANGE_HZ.1);
        // Returns the bins of a band with their weights. The bins at both ends count by the part that lies within the
        // band.
        let shares = |(low, high): (f64, f64)| {
            let (low, high) = (low / step_hz, high / step_hz);
            let bins = low.round() as usize..=(high.round() as usize).min(ratio.len() - 1);
            bins.map(move |bin| {
                let share = (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
                (bin, share)
            })
        };
        let (mut squares, mut width) = (0.0, 0.0);
        for (bin, share) in shares(RANGE_HZ) {
            squares += share * decibels(ratio[bin]).powi(2);
            width += share;
        }
        let mean_square = squares / width;
        let third_octaves = (0..BAND_COUNT).map(|band| {
            let (mut here, mut there) = (0.0, 0.0);
            for (bin, share) in shares(band_edges_hz(band)) {
                here += share * exact_density[bin];
                there += share * exact_density[bin] * ratio[bin];
            }
            decibels(there / here).abs()
        });
        let lines = range.filter(|&bin| is_line(&exact_density, bin)).map(|bin| {
            let [low, high] = [bin - 1, bin + 1].map(|bin| bin as f64 / length as f64);
            let peak = models[0].peak(low, high);
            decibels(models[1].density(peak) / models[0].density(peak)).abs()
        });
        Self {
            rms_db: mean_square.sqrt(),
            third_octave_db: third_octaves.fold(0.0, f64::max),
            line_db: lines.fold(0.0, f64::max),
        }
    }

    /// Returns the largest ratio of an error to its bound in `bounds`; at most 1 if all errors are within their bounds.
    pub fn share_of(self, bounds: Self) -> f64 {
        [
            self.rms_db / bounds.rms_db,
            self.third_octave_db / bounds.third_octave_db,
            self.line_db / bounds.line_db,
        ]
        .into_iter()
        .fold(0.0, f64::max)
    }
}

fn decibels(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}

/// Returns true if the densities have a peak at `bin` that falls by half within [`LINE_STEPS`].
fn is_line(densities: &[f64], bin: usize) -> bool {
    let Some(around) = densities.get(bin - LINE_STEPS..=bin + LINE_STEPS) else {
        return false;
    };
    let here = densities[bin];
    let half = |density: f64| density < 0.5 * here;
    around.iter().all(|&density| density <= here) && half(around[0]) && half(around[2 * LINE_STEPS])
}

/// A model of output power 1: A(z), and the power of its prediction error.
struct Polynomial {
    a: Vec<f64>,
    error_power: f64,
}

impl Polynomial {
    fn of(reflection: &[f64]) -> Self {
        Self {
            a: step_up(reflection),
            error_power: error_share(reflection),
        }
    }

    /// Returns the power density at a frequency, in cycles per sample.
    fn density(&self, turns: f64) -> f64 {
        let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
        let delay = Complex::new(cos, -sin);
        let tail = self.a.iter().rev().fold(Complex::ZERO, |sum, &a| (sum + a) * delay);
        self.error_power / (tail + 1.0).norm_sqr()
    }

    /// Returns the frequency of the highest density between `low` and `high`, where the density has one peak, by
    /// golden-section search.
    fn peak(&self, mut low: f64, mut high: f64) -> f64 {
        /// Enough for 10⁻⁷ of the interval, far less than the width of any line.
        const STEPS: usize = 34;
        const SHARE: f64 = 0.618_033_988_749_894_9;
        for _ in 0..STEPS {
            let width = SHARE * (high - low);
            let [left, right] = [high - width, low + width];
            if self.density(left) > self.density(right) {
                high = right;
            } else {
                low = left;
            }
        }
        0.5 * (low + high)
    }
}

/// Returns the density of the first model at the lowest `bins` frequencies, and the ratio of the second model's density
/// to it.
fn densities(models: &[Polynomial; 2], length: usize, bins: usize) -> [Vec<f64>; 2] {
    let [exact, rounded] = models.each_ref().map(|model| {
        let mut response = vec![0.0; length];
        response[0] = 1.0;
        for (lag, &a) in (1..).zip(&model.a) {
            // Coefficients that are `length` apart have the same phase at every bin.
            response[lag % length] += a;
        }
        let spectrum = fourier::forward(&mut response);
        let density = |bin: &Complex<f64>| model.error_power / bin.norm_sqr();
        spectrum.iter().take(bins).map(density).collect::<Vec<f64>>()
    });
    let ratio = rounded.iter().zip(&exact).map(|(r, e)| r / e).collect();
    [exact, ratio]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RATE_HZ: f64 = 5000.0;

    proptest! {
        /// Reference: the definition, with sums over single frequencies, each evaluated separately.
        #[test]
        fn errors_are_those_of_the_densities(
            k in prop::collection::vec(-0.7f64..0.7, 1..12), by in -0.01f64..0.01,
        ) {
            let other: Vec<f64> = k.iter().map(|k| k + by).collect();
            let error = ModelError::between(&k, &other, RATE_HZ);
            let (a, b) = (Polynomial::of(&k), Polynomial::of(&other));
            let at = |model: &Polynomial, hz: f64| model.density(hz / RATE_HZ);
            let steps = |low: f64, high: f64| {
                let step_hz = (high - low) / 5000.0;
                (0..5000).map(move |step| low + step_hz * (f64::from(step) + 0.5))
            };
            let square = |hz: f64| decibels(at(&b, hz) / at(&a, hz)).powi(2);
            let squares: Vec<f64> = steps(20.0, 1000.0).map(square).collect();
            let (found, rms) = (error.rms_db, (squares.iter().sum::<f64>() / 5000.0).sqrt());
            // A sum over steps differs from the integral by less than a step times the total variation, so a line
            // that is narrower than a step allows more. 1e-6 dB is round-off.
            let variation: f64 = squares.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
            let bound = (WIDEST_STEP_HZ / 980.0 + 1.0 / 5000.0) * variation + 1e-6 * (found + rms);
            prop_assert!((found * found - rms * rms).abs() <= bound, "{found} {rms} {bound}");
            let bands = (0..BAND_COUNT).map(|band| {
                let (low, high) = band_edges_hz(band);
                let power = |model| steps(low, high).map(|hz| at(model, hz)).sum::<f64>();
                decibels(power(&b) / power(&a)).abs()
            });
            let worst = bands.fold(0.0, f64::max);
            let found = error.third_octave_db;
            prop_assert!((found - worst).abs() < 0.02 * worst + 1e-3, "{found} {worst}");
        }
    }

    /// A line of 0.016 Hz width, between two of the frequencies that are compared, is moved by a tenth of its width.
    #[test]
    fn a_line_is_found_between_the_steps_and_compared_in_its_place() {
        for line_hz in [60.0, 200.2, 517.77, 999.0] {
            let pole = |hz: f64| {
                let (radius, angle) = (0.99999f64, std::f64::consts::TAU * hz / RATE_HZ);
                let k2 = radius * radius;
                vec![-2.0 * radius * angle.cos() / (1.0 + k2), k2]
            };
            let error = ModelError::between(&pole(line_hz), &pole(line_hz + 0.0016), RATE_HZ);
            // 1 + (2 · 0.1)², of a width of 0.016 Hz.
            assert!((error.line_db - 0.17).abs() < 0.02, "{line_hz}: {error:?}");
            let wide = ModelError::between(&[-0.9, 0.99], &[-0.9, 0.9901], RATE_HZ);
            assert_eq!(wide.line_db, 0.0);
        }
    }
}
