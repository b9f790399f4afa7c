//! A spectrum as its values: power, interpolation, warping and means.

use model_format::SAMPLE_RATE_HZ;

/// Length of the transforms behind a spectrum, samples: 2 s.
pub(super) const LENGTH: usize = 10_000;

/// Number of frequencies of a recording's spectrum, from 0 Hz to half the models' sample rate.
pub const BINS: usize = LENGTH / 2 + 1;

/// Number of frequencies that resolve the resonances of models of any order fitted to 2 s: 0.06 Hz apart.
pub const FINE_BINS: usize = 4 * LENGTH + 1;

/// Step between the frequencies of [`BINS`], Hz.
pub const STEP_HZ: f64 = SAMPLE_RATE_HZ as f64 / LENGTH as f64;

/// Logarithm of a power spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSpectrum(Vec<f64>);

impl LogSpectrum {
    /// A spectrum from its values, evenly spaced from 0 Hz to half the sample rate.
    ///
    /// # Panics
    /// For fewer than two values.
    pub fn from_values(values: Vec<f64>) -> Self {
        assert!(values.len() > 1, "a spectrum has two ends");
        Self(values)
    }

    /// Returns the values.
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// Returns the power, in (signal's unit)².
    pub fn power(&self) -> f64 {
        let last = self.0.len() - 1;
        let inner: f64 = self.0[1..last].iter().map(|l| l.exp()).sum();
        (self.0[0].exp() + 2.0 * inner + self.0[last].exp()) / (2 * last) as f64
    }

    /// Returns the spectrum of the same surface at another speed, on the assumption that all of it comes from the
    /// surface: components at f move to f · `to_speed` / `from_speed`. The last value continues beyond half the sample
    /// rate.
    #[must_use]
    pub fn warped(&self, from_speed: f64, to_speed: f64) -> Self {
        let ratio = from_speed / to_speed;
        Self(
            (0..self.0.len())
                .map(|bin| self.at(bin as f64 * ratio))
                .collect(),
        )
    }

    /// Interpolates the value at a fractional bin; the values at both ends continue beyond them.
    pub(crate) fn at(&self, bin: f64) -> f64 {
        let bin = bin.clamp(0.0, (self.0.len() - 1) as f64);
        let below = (bin as usize).min(self.0.len() - 2);
        let fraction = bin - below as f64;
        self.0[below] + (self.0[below + 1] - self.0[below]) * fraction
    }

    /// Returns the weighted mean of spectra with equal numbers of frequencies; the weights add up to one.
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
