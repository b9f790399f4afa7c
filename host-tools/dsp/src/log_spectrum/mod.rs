//! Logarithms of power spectra: computed from models, and converted into models.
//!
//! Values are evenly spaced from 0 Hz to half the models' sample rate. Each value is the natural logarithm of the
//! two-sided density times the sample rate, so that the mean of their exponentials over all frequencies is the power.
//! A spectrum has [`BINS`] values, [`STEP_HZ`] apart, as a recording of 2 s resolves. It may have more, because a
//! resonance of a model can be narrower.

mod models;

pub use models::density_of_model;

use model_format::SAMPLE_RATE_HZ;

/// Length of the transforms behind a spectrum, samples: 2 s.
const LENGTH: usize = 10_000;

/// Number of frequencies that 2 s resolve, from 0 Hz to half the models' sample rate.
pub const BINS: usize = LENGTH / 2 + 1;

/// Number of frequencies, 0.06 Hz apart, that resolve the resonances of models of any order fitted to 2 s.
pub const FINE_BINS: usize = 4 * LENGTH + 1;

/// Step between the frequencies of [`BINS`], Hz.
pub const STEP_HZ: f64 = SAMPLE_RATE_HZ as f64 / LENGTH as f64;

/// Logarithm of a power spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSpectrum(Vec<f64>);

impl LogSpectrum {
    /// Creates a spectrum from its values, evenly spaced from 0 Hz to half the sample rate.
    /// Panics if there are fewer than two values.
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

    /// Interpolates the value at a fractional bin. Beyond each end, the value at the end is used.
    pub fn at(&self, bin: f64) -> f64 {
        let bin = bin.clamp(0.0, (self.0.len() - 1) as f64);
        let below = (bin as usize).min(self.0.len() - 2);
        let fraction = bin - below as f64;
        self.0[below] + (self.0[below + 1] - self.0[below]) * fraction
    }
}
