//! Log-spectral distance between signals of any lengths.

use super::bands::{THIRD_OCTAVE, level_db};
use super::power::PowerSpectrum;

/// Number of windows that begin within a third octave.
const WINDOWS_PER_THIRD_OCTAVE: f64 = 10.0;

/// Log-spectral distance, dB: the RMS difference, over the logarithm of frequency from `low_hz` to `high_hz`, of two
/// power spectra in dB, each smoothed by a sliding third-octave window.
///
/// The spectra are [`PowerSpectrum::welch`], so that signals of different lengths can be compared. Windows lie wholly
/// within the range, at steps of a tenth of a third octave; a range narrower than a third octave is one window. A third
/// octave is about the just noticeable difference of frequency on skin (Weber fraction 0.18 to 0.25, Israr 2006). It
/// also averages the scatter of single bins, which would otherwise dominate the distance between two takes of one
/// surface. Differences of level count; to compare shapes only, scale both signals to the same power first.
///
/// Returns `None` if the range is empty, or if one of the signals has no power in some window.
pub fn log_spectral_distance_db(
    a: &[f64],
    b: &[f64],
    rate_hz: f64,
    low_hz: f64,
    high_hz: f64,
) -> Option<f64> {
    let (a, b) = (
        PowerSpectrum::welch(a, rate_hz),
        PowerSpectrum::welch(b, rate_hz),
    );
    distance_of_spectra_db(&a, &b, low_hz, high_hz)
}

/// [`log_spectral_distance_db`] of two spectra that were estimated with one length of segments.
pub fn distance_of_spectra_db(
    a: &PowerSpectrum,
    b: &PowerSpectrum,
    low_hz: f64,
    high_hz: f64,
) -> Option<f64> {
    let mut squares = Vec::new();
    for (low, high) in third_octave_windows(low_hz, high_hz) {
        let difference = level_db(a.power_between(low, high) / b.power_between(low, high))?;
        squares.push(difference * difference);
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    Some(mean.sqrt()).filter(|distance| distance.is_finite())
}

/// Returns windows of a third octave at steps of a tenth of that, from edge to edge of a range of frequencies, in Hz.
fn third_octave_windows(low_hz: f64, high_hz: f64) -> Vec<(f64, f64)> {
    if !(low_hz > 0.0 && low_hz < high_hz) {
        return Vec::new();
    }
    let room = (high_hz / low_hz).log10() - THIRD_OCTAVE;
    if room <= 0.0 {
        return vec![(low_hz, high_hz)];
    }
    let steps = (room / THIRD_OCTAVE * WINDOWS_PER_THIRD_OCTAVE).ceil();
    let width = 10f64.powf(THIRD_OCTAVE);
    (0..=steps as u32)
        .map(|step| {
            let low = low_hz * 10f64.powf(room * f64::from(step) / steps);
            (low, low * width)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close, noise, scaled, sine};
    use super::*;

    #[test]
    fn log_spectral_distance_is_a_distance_of_levels() {
        let (a, b) = (noise(25_000, 7), noise(25_000, 8));
        let distance =
            |a: &[f64], b: &[f64]| log_spectral_distance_db(a, b, RATE_HZ, 30.0, 1000.0).unwrap();
        assert_eq!(distance(&a, &a).to_bits(), 0.0f64.to_bits());
        assert!(close(distance(&a, &b), distance(&b, &a), 1e-12));
        assert!(close(distance(&a, &scaled(&a, 10.0)), 20.0, 1e-9));
        // Two takes of one noise are near, even though of different lengths.
        assert!(distance(&a, &b) < 1.5, "{}", distance(&a, &b));
        assert!(distance(&a, &scaled(&b[..15_000], 2.0)) > 5.0);
    }

    #[test]
    fn log_spectral_distance_hears_nothing_outside_its_range() {
        let a = noise(25_000, 9);
        let tone = sine(25_000, 1500.0, 30.0);
        let with_tone: Vec<f64> = a.iter().zip(&tone).map(|(a, tone)| a + tone).collect();
        let within = log_spectral_distance_db(&a, &with_tone, RATE_HZ, 30.0, 1000.0).unwrap();
        let across = log_spectral_distance_db(&a, &with_tone, RATE_HZ, 30.0, 2000.0).unwrap();
        assert!(within < 0.1 && across > 5.0, "{within}, {across}");
    }

    #[test]
    fn log_spectral_distance_without_a_range_or_power_is_none() {
        let a = noise(5000, 10);
        for (low_hz, high_hz) in [
            (100.0, 100.0),
            (200.0, 100.0),
            (0.0, 100.0),
            (f64::NAN, 100.0),
            (30.0, 4000.0),
        ] {
            assert_eq!(
                log_spectral_distance_db(&a, &a, RATE_HZ, low_hz, high_hz),
                None
            );
        }
        assert_eq!(
            log_spectral_distance_db(&a, &vec![0.0; 5000], RATE_HZ, 30.0, 1000.0),
            None
        );
        assert_eq!(
            log_spectral_distance_db(&a, &a, RATE_HZ, 100.0, 105.0),
            Some(0.0)
        );
    }
}
