//! Logarithms of power spectra: estimated from recordings with little leakage, computed from models, warped from one
//! speed to another, and converted into models.
//!
//! Values are evenly spaced from 0 Hz to half the models' sample rate. Each value is the natural logarithm of the
//! two-sided density times the sample rate, so that the mean of their exponentials over all frequencies is the power.
//! Spectra of recordings have [`BINS`] values, [`STEP_HZ`] apart. Spectra of models may have more values, because a
//! resonance of a model can be narrower than any resonance that a recording resolves.

mod estimate;
mod models;

pub use models::density_of_model;

use model_format::SAMPLE_RATE_HZ;

use super::spectrum::{BAND_COUNT, band_edges_hz};

/// Length of the transforms behind a spectrum, samples: 2 s.
const LENGTH: usize = 10_000;

/// Number of frequencies of a recording's spectrum, from 0 Hz to half the models' sample rate.
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

    /// Returns the spectrum of the same surface at another speed, on the assumption that the whole spectrum comes from
    /// the surface: components at f move to f · `to_speed` / `from_speed`. Beyond half the sample rate, the last value
    /// is used.
    #[must_use]
    pub fn warped(&self, from_speed: f64, to_speed: f64) -> Self {
        let ratio = from_speed / to_speed;
        Self(
            (0..self.0.len())
                .map(|bin| self.at(bin as f64 * ratio))
                .collect(),
        )
    }

    /// Interpolates the value at a fractional bin. Beyond each end, the value at the end is used.
    pub fn at(&self, bin: f64) -> f64 {
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

    /// Returns the level of `other` relative to this spectrum in each third-octave band, in dB; `None` if it is not
    /// finite. Both spectra have [`BINS`] values.
    pub fn band_errors_db(&self, other: &Self) -> [Option<f64>; BAND_COUNT] {
        std::array::from_fn(|band| {
            let (low, high) = band_edges_hz(band);
            let (low, high) = (low / STEP_HZ, high / STEP_HZ);
            let ratio = other.power_between(low, high) / self.power_between(low, high);
            Some(10.0 * ratio.log10()).filter(|level| level.is_finite())
        })
    }

    /// Returns the power between two fractional bins of [`BINS`], up to a constant factor.
    pub fn power_between(&self, low: f64, high: f64) -> f64 {
        let first = low.round().max(0.0) as usize;
        let last = (high.round() as usize).min(BINS - 1);
        (first..=last)
            .map(|bin| {
                let share = (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
                self.values()[bin].exp() * share.max(0.0)
            })
            .sum()
    }

    /// Returns the paper's cost C, equation (6), of a signal with the spectrum `other` against a signal with this
    /// spectrum. Neither has the scatter of an estimate. Amplitudes are averaged over a running window of `width_hz`.
    /// Both spectra have [`BINS`] values.
    pub fn cost(&self, other: &Self, width_hz: f64) -> f64 {
        let (here, there) = (
            self.smoothed_amplitude(width_hz),
            other.smoothed_amplitude(width_hz),
        );
        let difference: f64 = here.iter().zip(&there).map(|(a, b)| (a - b).powi(2)).sum();
        let energy: f64 = here.iter().map(|a| a * a).sum();
        (difference / energy).sqrt()
    }

    fn smoothed_amplitude(&self, width_hz: f64) -> Vec<f64> {
        let half = (0.5 * width_hz / STEP_HZ) as usize;
        let mut sums = vec![0.0; BINS + 1];
        for (bin, value) in self.values().iter().enumerate() {
            sums[bin + 1] = sums[bin] + (0.5 * value).exp();
        }
        (0..BINS)
            .map(|bin| {
                let (first, end) = (bin.saturating_sub(half), (bin + half + 1).min(BINS));
                (sums[end] - sums[first]) / (end - first) as f64
            })
            .collect()
    }
}
