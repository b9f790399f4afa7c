//! A spectrum as its values: power, interpolation, warping and means.

use model_format::SAMPLE_RATE_HZ;

/// Length of the transforms behind a spectrum, samples: 2 s.
pub(super) const LENGTH: usize = 10_000;

/// Frequencies of a spectrum, from 0 Hz to half the models' rate.
pub const BINS: usize = LENGTH / 2 + 1;

/// Frequencies that hold the resonances of models of any order fitted to 2 s: 0.06 Hz apart.
pub const FINE_BINS: usize = 4 * LENGTH + 1;

/// From one frequency to the next of [`BINS`], Hz.
pub const STEP_HZ: f64 = SAMPLE_RATE_HZ as f64 / LENGTH as f64;

/// The logarithm of a power spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSpectrum(Vec<f64>);

impl LogSpectrum {
    /// A spectrum from its values, evenly from 0 Hz to half the rate.
    ///
    /// # Panics
    /// If there are fewer than two.
    pub fn from_values(values: Vec<f64>) -> Self {
        assert!(values.len() > 1, "a spectrum has two ends");
        Self(values)
    }

    /// Its values.
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// The power, (signal's unit)².
    pub fn power(&self) -> f64 {
        let last = self.0.len() - 1;
        let inner: f64 = self.0[1..last].iter().map(|l| l.exp()).sum();
        (self.0[0].exp() + 2.0 * inner + self.0[last].exp()) / (2 * last) as f64
    }

    /// The spectrum of the same surface at another speed, if all of it came from the surface: what stood at f now stands
    /// at f · `to_speed` / `from_speed`. Beyond half the rate the last value goes on.
    #[must_use]
    pub fn warped(&self, from_speed: f64, to_speed: f64) -> Self {
        let ratio = from_speed / to_speed;
        Self(
            (0..self.0.len())
                .map(|bin| self.at(bin as f64 * ratio))
                .collect(),
        )
    }

    /// The value at a place between bins, in bins; the ends go on.
    pub(crate) fn at(&self, place: f64) -> f64 {
        let place = place.clamp(0.0, (self.0.len() - 1) as f64);
        let below = (place as usize).min(self.0.len() - 2);
        let fraction = place - below as f64;
        self.0[below] + (self.0[below + 1] - self.0[below]) * fraction
    }

    /// The weighted mean of logarithms of one number of frequencies; weights add up to one.
    pub fn mean(terms: &[(f64, &Self)]) -> Self {
        let mut sum = vec![0.0; terms.first().map_or(BINS, |(_, spectrum)| spectrum.0.len())];
        for (weight, spectrum) in terms {
            for (sum, value) in sum.iter_mut().zip(&spectrum.0) {
                *sum += weight * value;
            }
        }
        Self(sum)
    }
}
