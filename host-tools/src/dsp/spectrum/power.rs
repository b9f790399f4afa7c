//! Power spectral density, by Welch's estimate.

use std::f64::consts::TAU;

use super::amplitude::dft_amplitude;

/// Duration of a segment of Welch's estimate, s. It resolves the lowest third-octave band, which is 4.6 Hz wide.
const SEGMENT_S: f64 = 1.0;

/// Power spectral density of a signal.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerSpectrum {
    /// One-sided density, (signal's unit)²/Hz. Value k is for the frequencies nearer to k · `step_hz` than to any
    /// other.
    density: Vec<f64>,
    step_hz: f64,
    nyquist_hz: f64,
}

impl PowerSpectrum {
    /// Welch's estimate: the mean periodogram of Hann-windowed segments of 1 s, or of the whole signal if it is
    /// shorter. Segments overlap by half, or by slightly more so that the last one ends with the signal.
    ///
    /// The density is scaled by the window's energy, so that it integrates to the power of a stationary signal. A
    /// signal of fewer than two samples has no power here, because a window of one sample is zero.
    pub fn welch(signal: &[f64], rate_hz: f64) -> Self {
        let segment = ((SEGMENT_S * rate_hz).round() as usize).clamp(1, signal.len().max(1));
        let window: Vec<f64> = (0..segment)
            .map(|n| 0.5 - 0.5 * (TAU * n as f64 / segment as f64).cos())
            .collect();
        let window_energy: f64 = window.iter().map(|weight| weight * weight).sum();
        let spare = signal.len().saturating_sub(segment);
        let hops = (2 * spare).div_ceil(segment);
        let mut density = vec![0.0; segment / 2 + 1];
        if segment > 1 {
            let scale = 2.0 / (rate_hz * window_energy * (hops + 1) as f64);
            for hop in 0..=hops {
                let begin = (spare * hop).checked_div(hops).unwrap_or(0);
                let windowed: Vec<f64> = signal[begin..]
                    .iter()
                    .zip(&window)
                    .map(|(value, weight)| value * weight)
                    .collect();
                for (sum, amplitude) in density.iter_mut().zip(dft_amplitude(&windowed)) {
                    *sum += scale * amplitude * amplitude;
                }
            }
        }
        Self {
            density,
            step_hz: rate_hz / segment as f64,
            nyquist_hz: rate_hz / 2.0,
        }
    }

    /// Returns the power between two frequencies, in (signal's unit)²: the integral of the density, with fractional
    /// bins at both ends.
    ///
    /// The first bin starts at 0 Hz and the last one ends at half the sample rate; there is no power beyond.
    pub fn power_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let (low, high) = (low_hz.max(0.0), high_hz.min(self.nyquist_hz));
        if low >= high {
            return 0.0;
        }
        let first = (low / self.step_hz).round() as usize;
        let mut power = 0.0;
        for (index, density) in self.density.iter().enumerate().skip(first) {
            let (begin, end) = (
                (index as f64 - 0.5) * self.step_hz,
                (index as f64 + 0.5) * self.step_hz,
            );
            if begin >= high {
                break;
            }
            power += density * (end.min(high) - begin.max(low)).max(0.0);
        }
        power
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close, noise};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_welch_density_of_one_segment_keeps_the_windowed_energy(len in 2usize..600, seed: u64) {
            let signal = noise(len, seed);
            let hann = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / len as f64).cos();
            let (mut energy, mut window_energy) = (0.0, 0.0);
            for (n, x) in signal.iter().enumerate() {
                energy += (hann(n) * x).powi(2);
                window_energy += hann(n).powi(2);
            }
            let power = PowerSpectrum::welch(&signal, RATE_HZ).power_between(0.0, RATE_HZ / 2.0);
            prop_assert!(close(power, energy / window_energy, 1e-12));
        }

        #[test]
        fn power_is_the_sum_over_any_division_of_the_frequencies(
            len in 100usize..600, seed: u64, mut cuts in prop::collection::vec(0.0..2500.0f64, 1..20),
        ) {
            let spectrum = PowerSpectrum::welch(&noise(len, seed), RATE_HZ);
            cuts.extend([0.0, 2500.0]);
            cuts.sort_by(f64::total_cmp);
            let sum: f64 = cuts.windows(2).map(|cut| spectrum.power_between(cut[0], cut[1])).sum();
            prop_assert!(close(sum, spectrum.power_between(-1.0, 1e9), 1e-12));
        }
    }
}
