//! Differences between spectra of [`BINS`] values.

use super::values::{BINS, LogSpectrum, STEP_HZ};
use crate::dsp::spectrum::{BAND_COUNT, band_edges_hz};

impl LogSpectrum {
    /// Returns the level of `other` relative to this spectrum in each third-octave band, in dB. Both have [`BINS`]
    /// values.
    pub fn band_errors_db(&self, other: &Self) -> [Option<f64>; BAND_COUNT] {
        std::array::from_fn(|band| {
            let (low, high) = band_edges_hz(band);
            let ratio = other.power_between(low, high) / self.power_between(low, high);
            Some(10.0 * ratio.log10()).filter(|level| level.is_finite())
        })
    }

    /// Returns the power between two frequencies on one side of the spectrum, with fractional bins at both ends.
    fn power_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let (low, high) = (low_hz / STEP_HZ, high_hz / STEP_HZ);
        let first = low.round().max(0.0) as usize;
        let last = (high.round() as usize).min(BINS - 1);
        (first..=last)
            .map(|bin| {
                let share = (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
                self.values()[bin].exp() * share.max(0.0)
            })
            .sum()
    }

    /// Returns the paper's cost C, equation (6), of a signal with the spectrum `other` against one with this spectrum,
    /// without the scatter of either: amplitudes are averaged over a running window of `width_hz`. Both have [`BINS`]
    /// values.
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
