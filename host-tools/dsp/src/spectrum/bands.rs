//! Third-octave bands, the power and error of a signal in each, and the log-spectral distance.

use super::power::PowerSpectrum;

/// Just noticeable difference of amplitude, dB: the lower end of 2.2 to 2.5 dB (Israr 2006). Smaller errors are not
/// felt.
pub const AMPLITUDE_JND_DB: f64 = 2.2;

/// Number of third-octave bands, from 20 Hz to 1 kHz. Skin feels this range and a stylus can play it.
pub const BAND_COUNT: usize = 18;

/// Nominal centre frequencies of the bands, Hz, as IEC 61260-1 labels them.
pub const BAND_LABELS_HZ: [&str; BAND_COUNT] = [
    "20", "25", "31.5", "40", "50", "63", "80", "100", "125", "160", "200", "250", "315", "400", "500", "630", "800",
    "1000",
];

/// Third octave in base ten (IEC 61260-1), as a difference of decimal logarithms of frequency.
const THIRD_OCTAVE: f64 = 0.1;

/// Ratio of the edges of a third octave: 10^(1/10), base ten of IEC 61260-1.
pub const THIRD_OCTAVE_RATIO: f64 = 1.258_925_411_794_167_3;

/// Returns the exact centre frequency of band `band`, the index into [`BAND_LABELS_HZ`], in Hz: 1000 · 10^(k/10),
/// k = -17 ... 0, base ten of IEC 61260-1.
pub fn band_centre_hz(band: usize) -> f64 {
    third_octave_hz(band as f64)
}

/// Returns the lower and upper edge of band `band`, in Hz: its exact centre · 10^(∓1/20). Each band ends where the next
/// begins.
pub fn band_edges_hz(band: usize) -> (f64, f64) {
    // Halves are exact in binary, so that the common edge of two bands is the same number for both.
    let band = band as f64;
    (third_octave_hz(band - 0.5), third_octave_hz(band + 0.5))
}

/// Returns the frequency at a position on the scale of third octaves, Hz. Whole numbers are the exact centres of bands,
/// 0 that at 20 Hz and 17 that at 1 kHz; halves are their edges.
pub fn third_octave_hz(band: f64) -> f64 {
    1000.0 * 10f64.powf((band - (BAND_COUNT - 1) as f64) * THIRD_OCTAVE)
}

/// Returns the power in each third-octave band, in (signal's unit)², from [`PowerSpectrum::welch`].
///
/// For a signal shorter than about 0.3 s, the resolution is coarser than the lowest bands, which then share power.
/// There is no power above half the sample rate.
pub fn band_powers(signal: &[f64], rate_hz: f64) -> [f64; BAND_COUNT] {
    let spectrum = PowerSpectrum::welch(signal, rate_hz);
    std::array::from_fn(|band| {
        let (low, high) = band_edges_hz(band);
        spectrum.power_between(low, high)
    })
}

/// Returns the level of the synthesised signal relative to the recorded one in each third-octave band, in dB.
///
/// The level is `None` for a band in which one of the signals has no power.
pub fn band_errors_db(recorded: &[f64], synthesised: &[f64], rate_hz: f64) -> [Option<f64>; BAND_COUNT] {
    let (reference, other) = (band_powers(recorded, rate_hz), band_powers(synthesised, rate_hz));
    std::array::from_fn(|band| level_db(other[band] / reference[band]))
}

/// Like [`band_errors_db`], for two spectra, in the bands that lie within `low_hz` to `high_hz`. Other bands are
/// `None`.
pub fn band_errors_within_db(
    recorded: &PowerSpectrum,
    synthesised: &PowerSpectrum,
    (low_hz, high_hz): (f64, f64),
) -> [Option<f64>; BAND_COUNT] {
    // Band edges are powers of ten, which are rounded. With this tolerance, a range that ends at an edge includes the
    // band.
    let slack = 1e-9;
    std::array::from_fn(|band| {
        let (low, high) = band_edges_hz(band);
        let is_within = low >= low_hz * (1.0 - slack) && high <= high_hz * (1.0 + slack);
        let power = |spectrum: &PowerSpectrum| spectrum.power_between(low, high);
        level_db(power(synthesised) / power(recorded)).filter(|_| is_within)
    })
}

/// Converts a ratio of powers to dB; `None` if the level is not finite.
fn level_db(ratio: f64) -> Option<f64> {
    Some(10.0 * ratio.log10()).filter(|level| level.is_finite())
}

/// Number of windows that begin within a third octave.
const WINDOWS_PER_THIRD_OCTAVE: f64 = 10.0;

/// Returns the log-spectral distance, dB, from `low_hz` to `high_hz`: the RMS difference, over the logarithm of
/// frequency, of two power spectra in dB, each smoothed by a sliding third-octave window.
///
/// Both spectra must have segments of the same length ([`PowerSpectrum::welch`]). Signals of different lengths can then
/// be compared. Windows lie wholly within the range, at steps of up to a tenth of a third octave; a range narrower than
/// a third octave is one window. A third octave is about the just noticeable difference of frequency on skin (Weber
/// fraction 0.18 to 0.25, Israr 2006). It also averages the scatter of single bins, which would otherwise dominate the
/// distance between two takes of one surface. Differences of level count; to compare only shapes, scale both signals to
/// the same power first.
///
/// Returns `None` if the range is empty, or if one of the signals has no power in some window.
pub fn distance_of_spectra_db(a: &PowerSpectrum, b: &PowerSpectrum, low_hz: f64, high_hz: f64) -> Option<f64> {
    let mut squares = Vec::new();
    for (low, high) in third_octave_windows(low_hz, high_hz) {
        let difference = level_db(a.power_between(low, high) / b.power_between(low, high))?;
        squares.push(difference * difference);
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    Some(mean.sqrt()).filter(|distance| distance.is_finite())
}

/// Returns third-octave windows at steps of up to a tenth of their width, from edge to edge of a range, in Hz.
fn third_octave_windows(low_hz: f64, high_hz: f64) -> Vec<(f64, f64)> {
    // The comparisons are false for a NaN.
    if !(low_hz > 0.0 && low_hz < high_hz) {
        return Vec::new();
    }
    let room = (high_hz / low_hz).log10() - THIRD_OCTAVE;
    if room <= 0.0 {
        return vec![(low_hz, high_hz)];
    }
    let steps = (room / THIRD_OCTAVE * WINDOWS_PER_THIRD_OCTAVE).ceil();
    (0..=steps as u32)
        .map(|step| {
            let low = low_hz * 10f64.powf(room * f64::from(step) / steps);
            (low, low * THIRD_OCTAVE_RATIO)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close, scaled, sine};
    use super::*;
    use test_helpers::noise;

    #[test]
    fn bands_are_contiguous_and_carry_the_standards_labels() {
        for (band, label) in BAND_LABELS_HZ.iter().enumerate() {
            let nominal: f64 = label.parse().unwrap();
            assert!(close(nominal, band_centre_hz(band), 0.02), "{label}");
            let (low, high) = band_edges_hz(band);
            assert!(close(low * high, band_centre_hz(band).powi(2), 1e-12));
            assert!(close(high / low, 10f64.powf(0.1), 1e-12));
            if band + 1 < BAND_COUNT {
                assert_eq!(high.to_bits(), band_edges_hz(band + 1).0.to_bits());
            }
        }
        assert!(close(band_centre_hz(BAND_COUNT - 1), 1000.0, 1e-15));
    }

    #[test]
    fn a_sine_has_its_power_in_its_own_band() {
        for band in 0..BAND_COUNT {
            let powers = band_powers(&sine(10_000, band_centre_hz(band), 3.0), RATE_HZ);
            assert!(
                close(powers[band], 4.5, 0.01),
                "{} Hz: {}",
                BAND_LABELS_HZ[band],
                powers[band]
            );
            for (other, power) in powers.iter().enumerate() {
                assert!(
                    other == band || *power < 0.01 * 4.5,
                    "{band} leaks into {other}: {power}"
                );
            }
        }
    }

    #[test]
    fn white_noise_has_power_in_proportion_to_a_bands_width() {
        let powers = band_powers(&scaled(&noise(5, 500_000), 2.0), RATE_HZ);
        for (band, power) in powers.iter().enumerate() {
            let (low, high) = band_edges_hz(band);
            let expected = 4.0 * (high - low) / (RATE_HZ / 2.0);
            // An estimate over T seconds and B hertz has a relative standard deviation of √(1/BT). Here T = 100 s.
            let deviation = (1.0 / ((high - low) * 100.0)).sqrt();
            assert!(
                close(*power, expected, 5.0 * deviation),
                "{band}: {power}, expected {expected}"
            );
        }
        let all: f64 = powers.iter().sum();
        let (low, high) = (band_edges_hz(0).0, band_edges_hz(BAND_COUNT - 1).1);
        assert!(close(all, 4.0 * (high - low) / (RATE_HZ / 2.0), 0.02));
    }

    #[test]
    fn a_band_is_in_error_by_the_gain_of_the_synthesis() {
        let signal = noise(6, 10_000);
        let errors = band_errors_db(&signal, &scaled(&signal, 2.0), RATE_HZ);
        assert!(
            errors
                .iter()
                .all(|error| close(error.unwrap(), 20.0 * 2f64.log10(), 1e-9))
        );
        assert_eq!(band_errors_db(&signal, &vec![0.0; 10_000], RATE_HZ), [None; BAND_COUNT]);
        assert_eq!(band_errors_db(&[], &signal, RATE_HZ), [None; BAND_COUNT]);
        // At a sample rate of 1 kHz, there is no power above 500 Hz, and the 500 Hz band contains only its lower half.
        let errors = band_errors_db(&signal, &signal, 1000.0);
        assert!(errors[..=14].iter().all(Option::is_some) && errors[15..].iter().all(Option::is_none));
    }

    fn distance_db(a: &[f64], b: &[f64], low_hz: f64, high_hz: f64) -> Option<f64> {
        let [a, b] = [a, b].map(|signal| PowerSpectrum::welch(signal, RATE_HZ));
        distance_of_spectra_db(&a, &b, low_hz, high_hz)
    }

    #[test]
    fn log_spectral_distance_is_a_distance_of_levels() {
        let (a, b) = (noise(7, 25_000), noise(8, 25_000));
        let distance = |a: &[f64], b: &[f64]| distance_db(a, b, 30.0, 1000.0).unwrap();
        assert_eq!(distance(&a, &a).to_bits(), 0.0f64.to_bits());
        assert!(close(distance(&a, &b), distance(&b, &a), 1e-12));
        assert!(close(distance(&a, &scaled(&a, 10.0)), 20.0, 1e-9));
        // Two takes of the same noise are near each other, even if their lengths differ.
        assert!(distance(&a, &b) < 1.5, "{}", distance(&a, &b));
        assert!(distance(&a, &scaled(&b[..15_000], 2.0)) > 5.0);
    }

    #[test]
    fn log_spectral_distance_hears_nothing_outside_its_range() {
        let a = noise(9, 25_000);
        let tone = sine(25_000, 1500.0, 30.0);
        let with_tone: Vec<f64> = a.iter().zip(&tone).map(|(a, tone)| a + tone).collect();
        let within = distance_db(&a, &with_tone, 30.0, 1000.0).unwrap();
        let across = distance_db(&a, &with_tone, 30.0, 2000.0).unwrap();
        assert!(within < 0.1 && across > 5.0, "{within}, {across}");
    }

    #[test]
    fn log_spectral_distance_without_a_range_or_power_is_none() {
        let a = noise(10, 5000);
        for (low_hz, high_hz) in [
            (100.0, 100.0),
            (200.0, 100.0),
            (0.0, 100.0),
            (f64::NAN, 100.0),
            (30.0, 4000.0),
        ] {
            assert_eq!(distance_db(&a, &a, low_hz, high_hz), None);
        }
        assert_eq!(distance_db(&a, &vec![0.0; 5000], 30.0, 1000.0), None);
        assert_eq!(distance_db(&a, &a, 100.0, 105.0), Some(0.0));
    }
}
