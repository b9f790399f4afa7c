//! Estimates of a recording's autocorrelation, and the choice between them.
//!
//! A rectangular window uses every sample alike and has the finest resolution, but a strong band leaks into weak ones,
//! because the recording begins and ends in mid-air. Tapered ends leak next to nothing and weigh a tenth of a second
//! less. [`Estimator::Auto`] measures the leakage and tapers where it matters.

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::autocorrelation::{Autocorrelation, Tapered};
use crate::dsp::log_spectrum::LogSpectrum;

use super::bands::Bands;
use super::options::Estimator;

/// Leakage in any third-octave band above which [`Estimator::Auto`] tapers the ends, dB.
pub(super) const TOLERABLE_LEAKAGE_DB: f64 = 1.0;

/// Statistics of a recording that a model is fitted to and checked by.
pub(super) struct Estimate {
    /// Autocorrelation from lag 0 on, (m/s²)²; lag 0 is the recording's power.
    pub lags: Vec<f64>,
    /// Third-octave bands of the recording with tapered ends.
    pub bands: Bands,
}

/// Estimates the autocorrelation of `signal` at 5 kHz, whose plain autocorrelation is `plain`.
pub(super) fn estimate(signal: &[f64], plain: Autocorrelation, estimator: Estimator) -> Estimate {
    estimate_at(f64::from(SAMPLE_RATE_HZ), signal, plain, estimator)
}

/// As [`estimate`], of a signal at `rate_hz`.
pub(super) fn estimate_at(
    rate_hz: f64,
    signal: &[f64],
    plain: Autocorrelation,
    estimator: Estimator,
) -> Estimate {
    let power = plain.lags[0];
    let max_lag = plain.lags.len() - 1;
    let tapered = Tapered::of(signal, max_lag);
    let bands = Bands::of_density(&tapered.power(), power, rate_hz);
    let leakage_db = || {
        let plain = Bands::of_density(&plain.power, power, rate_hz);
        bands.largest_excess_db(&plain, signal.len())
    };
    let lags = match estimator {
        Estimator::Auto if leakage_db() > TOLERABLE_LEAKAGE_DB => {
            tapered.into_autocorrelation().lags
        }
        Estimator::Auto | Estimator::Rectangular => plain.lags,
        Estimator::Tapered => tapered.into_autocorrelation().lags,
        Estimator::Multitaper => multitaper_lags(signal, plain.lags),
    };
    Estimate { lags, bands }
}

/// As many lags as `plain`, from tapered spectra, with the power of `plain`.
fn multitaper_lags(signal: &[f64], plain: Vec<f64>) -> Vec<f64> {
    let Some(spectrum) = LogSpectrum::estimate(&[signal]).filter(|_| plain[0] > 0.0) else {
        return plain;
    };
    let mut lags = spectrum.autocorrelation(plain.len() - 1);
    let scale = plain[0] / lags[0];
    lags.iter_mut().for_each(|lag| *lag *= scale);
    lags
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(seed: u64) -> impl Iterator<Item = f64> {
        StandardNormal.sample_iter(rand_pcg::Pcg64::seed_from_u64(seed))
    }

    fn chosen(signal: &[f64]) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let lags = |estimator| estimate(signal, Autocorrelation::of(signal, 400), estimator).lags;
        (
            lags(Estimator::Auto),
            lags(Estimator::Rectangular),
            lags(Estimator::Tapered),
        )
    }

    #[test]
    fn ends_are_tapered_where_a_strong_band_leaks_and_nowhere_else() {
        let white: Vec<f64> = noise(1).take(20_000).collect();
        let (auto, rectangular, tapered) = chosen(&white);
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
        let (auto, rectangular, tapered) = chosen(&steep);
        assert_eq!(auto, tapered);
        assert_ne!(auto, rectangular);
    }

    #[test]
    fn every_estimate_has_the_recordings_power() {
        let signal: Vec<f64> = noise(2).take(7000).map(|x| 3.0 * x).collect();
        let power = signal.iter().map(|x| x * x).sum::<f64>() / 7000.0;
        for estimator in [
            Estimator::Auto,
            Estimator::Rectangular,
            Estimator::Tapered,
            Estimator::Multitaper,
        ] {
            let lags = estimate(&signal, Autocorrelation::of(&signal, 400), estimator).lags;
            assert!((lags[0] / power - 1.0).abs() < 1e-9, "{estimator:?}");
            assert_eq!(lags.len(), 401, "{estimator:?}");
        }
    }
}
