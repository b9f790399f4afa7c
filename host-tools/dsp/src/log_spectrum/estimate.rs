//! Estimates of spectra from recordings.

use std::f64::consts::{EULER_GAMMA, PI};

use super::{BINS, LENGTH, LogSpectrum};
use crate::fourier;

/// Number of sine tapers of an estimate. The bandwidth for 2 s is 4 Hz, and the leakage decreases with the fourth power
/// of the distance (Riedel and Sidorenko, IEEE Trans. Signal Processing 43, 1995, 188).
const TAPERS: usize = 7;

/// Lower bound of the density before its logarithm is taken, as a fraction of the power: 120 dB below it.
const FLOOR: f64 = 1e-12;

impl LogSpectrum {
    /// Estimates the common spectrum of `signals`, at the models' sample rate, each weighted by its length. Each signal
    /// is divided into pieces of at most 2 s, and the spectrum of a piece is the mean of seven periodograms with sine
    /// tapers. Returns `None` if the signals have no power.
    ///
    /// The logarithm of the mean of n periodograms is biased by -(ln n - ψ(n)). The estimate is corrected for this
    /// bias, so that means of logarithms have the level of the signal.
    pub fn estimate(signals: &[&[f64]]) -> Option<Self> {
        let mut density = vec![0.0; BINS];
        let (mut weight, mut periodograms) = (0.0, 0);
        for piece in signals.iter().flat_map(|signal| pieces(signal)) {
            for taper in 1..=TAPERS {
                add_periodogram(piece, taper, &mut density);
            }
            weight += piece.len() as f64;
            periodograms += TAPERS;
        }
        let power = density.iter().sum::<f64>() / (weight * BINS as f64);
        if !(power.is_finite() && power > 0.0) {
            return None;
        }
        let bias = (periodograms as f64).ln() - digamma(periodograms);
        let log = |sum: &f64| (sum / weight).max(FLOOR * power).ln() + bias;
        Some(Self::from_values(density.iter().map(log).collect()))
    }
}

/// Divides `signal` into the smallest number of equal pieces of at most [`LENGTH`] samples.
fn pieces(signal: &[f64]) -> impl Iterator<Item = &[f64]> {
    let count = signal.len().div_ceil(LENGTH).max(1);
    signal.chunks(signal.len().div_ceil(count).max(1))
}

/// Adds to `density` the periodogram of `piece` with the sine taper number `taper`, from 1, multiplied by the piece's
/// length.
fn add_periodogram(piece: &[f64], taper: usize, density: &mut [f64]) {
    let step = PI * taper as f64 / (piece.len() + 1) as f64;
    let scale = (2.0 / (piece.len() + 1) as f64).sqrt();
    let mut tapered = vec![0.0; LENGTH];
    for (n, (to, value)) in tapered.iter_mut().zip(piece).enumerate() {
        *to = scale * (step * (n + 1) as f64).sin() * value;
    }
    let spectrum = fourier::forward(&mut tapered);
    // Tapers have unit energy. This weight averages over the tapers; the caller averages over the pieces.
    let weight = piece.len() as f64 / TAPERS as f64;
    for (sum, bin) in density.iter_mut().zip(&spectrum) {
        *sum += weight * bin.norm_sqr();
    }
}

/// Digamma function ψ of an integer above zero (Abramowitz and Stegun 6.3.2).
fn digamma(n: usize) -> f64 {
    (1..n).map(|k| 1.0 / k as f64).sum::<f64>() - EULER_GAMMA
}

#[cfg(test)]
mod tests {
    use super::super::STEP_HZ;
    use super::*;
    use test_helpers::noise;

    #[test]
    fn the_mean_of_many_estimates_logarithms_is_the_logarithm_of_the_power() {
        let mut sum = 0.0;
        for seed in 0..20 {
            let signal = noise(seed, 7000 + 500 * seed as usize);
            let spectrum = LogSpectrum::estimate(&[&signal]).unwrap();
            sum += spectrum.values()[10..4990].iter().sum::<f64>() / 4980.0;
        }
        assert!((sum / 20.0).abs() < 0.02, "{}", sum / 20.0);
    }

    #[test]
    fn estimates_leak_less_than_a_rectangular_window() {
        // A spectral line of power 0.5 (m/s²)², 400 Hz from the frequency that is examined.
        let line: Vec<f64> = (0..10_000)
            .map(|n| (2.0 * PI * 200.3 * f64::from(n) / 5000.0).sin())
            .collect();
        let spectrum = LogSpectrum::estimate(&[&line]).unwrap();
        let far = spectrum.values()[1200].exp() / spectrum.power();
        assert!(10.0 * far.log10() < -60.0, "{}", 10.0 * far.log10());
        assert!(LogSpectrum::estimate(&[&[0.0; 100]]).is_none());
        assert!(LogSpectrum::estimate(&[]).is_none());
    }

    #[test]
    fn warping_moves_a_line_with_the_speed() {
        let peak = |spectrum: &LogSpectrum| {
            let values = spectrum.values().iter().enumerate();
            values.max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0 as f64 * STEP_HZ
        };
        let line: Vec<f64> = (0..10_000)
            .map(|n| (2.0 * PI * 120.0 * f64::from(n) / 5000.0).sin())
            .collect();
        let spectrum = LogSpectrum::estimate(&[&line]).unwrap();
        assert!((peak(&spectrum.warped(100.0, 150.0)) - 180.0).abs() < 3.0);
        assert_eq!(spectrum.warped(80.0, 80.0), spectrum);
    }
}
