//! The estimate of a recording's autocorrelation.
//!
//! A rectangular window uses every sample alike and has the finest resolution, but a strong band leaks into weak ones,
//! because the recording begins and ends in mid-air. Tapered ends leak next to nothing and weigh a tenth of a second
//! less. The leakage is measured, and the ends are tapered where it matters.

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::autocorrelation::{Autocorrelation, Tapered};

use super::bands::Bands;

/// Leakage in any third-octave band above which the ends are tapered, dB.
const TOLERABLE_LEAKAGE_DB: f64 = 1.0;

/// Statistics of a recording that a model is fitted to and checked by.
pub(super) struct Estimate {
    /// Autocorrelation from lag 0 on, (m/s²)²; lag 0 is the recording's power.
    pub lags: Vec<f64>,
    /// Third-octave bands of the recording with tapered ends.
    pub bands: Bands,
}

/// Estimates the autocorrelation of `signal` at 5 kHz, whose plain autocorrelation is `plain`.
pub(super) fn estimate(signal: &[f64], plain: Autocorrelation) -> Estimate {
    estimate_at(f64::from(SAMPLE_RATE_HZ), signal, plain)
}

/// As [`estimate`], of a signal at `rate_hz`.
pub(super) fn estimate_at(rate_hz: f64, signal: &[f64], plain: Autocorrelation) -> Estimate {
    let power = plain.lags[0];
    let tapered = Tapered::of(signal, plain.lags.len() - 1);
    let bands = Bands::of_density(&tapered.power(), power, rate_hz);
    let with_leakage = Bands::of_density(&plain.power, power, rate_hz);
    let lags = if bands.largest_excess_db(&with_leakage, signal.len()) > TOLERABLE_LEAKAGE_DB {
        tapered.into_autocorrelation().lags
    } else {
        plain.lags
    };
    Estimate { lags, bands }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(seed: u64) -> impl Iterator<Item = f64> {
        StandardNormal.sample_iter(rand_pcg::Pcg64::seed_from_u64(seed))
    }

    fn chosen(signal: &[f64]) -> [Vec<f64>; 3] {
        let plain = Autocorrelation::of(signal, 400);
        let tapered = Tapered::of(signal, 400).into_autocorrelation();
        let rectangular = plain.lags.clone();
        [estimate(signal, plain).lags, rectangular, tapered.lags]
    }

    #[test]
    fn ends_are_tapered_where_a_strong_band_leaks_and_nowhere_else() {
        let white: Vec<f64> = noise(1).take(20_000).collect();
        let [auto, rectangular, tapered] = chosen(&white);
        assert_eq!(auto, rectangular);
        assert_ne!(auto, tapered);
        // Integrated twice, noise falls by 12 dB per octave, and a rectangular window leaks 6 dB per octave.
        let (mut velocity, mut place) = (0.0, 0.0);
        let steep: Vec<f64> = white
            .iter()
            .map(|x| {
                velocity = 0.999 * velocity + x;
                place = 0.999 * place + velocity;
                place
            })
            .collect();
        let [auto, rectangular, tapered] = chosen(&steep);
        assert_eq!(auto, tapered);
        assert_ne!(auto, rectangular);
        assert!((auto[0] / rectangular[0] - 1.0).abs() < 1e-9);
    }
}
