//! Two measures of the agreement of spectra that are used to compare published texture models.

use super::power::PowerSpectrum;

/// Length of the segments, s. A recording of several seconds has many segments, so that their scatter averages out.
const SEGMENT_S: f64 = 0.2;

/// The agreement of two spectra.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Mean absolute difference of the decimal logarithms of the two power densities, over the bins of the range.
    pub log_power_mae: f64,
    /// Goodness-of-fit coefficient Σ ab / √(Σ a² Σ b²) of the amplitudes a and b at all frequencies. It is 1 for
    /// spectra that differ only by a factor (Romero, García-Beltrán, Hernández-Andrés, J. Opt. Soc. Am. A 14, 1997,
    /// 1007).
    pub fit_coefficient: f64,
}

/// Returns the agreement of two signals from `low_hz` to `high_hz`, by Welch's estimate with Hann-windowed segments of
/// 0.2 s. Returns `None` if a signal is shorter than a segment or has no power at a frequency, or if the range has no
/// bin.
pub fn agreement(
    a: &[f64],
    b: &[f64],
    rate_hz: f64,
    (low_hz, high_hz): (f64, f64),
) -> Option<Agreement> {
    let segment = (SEGMENT_S * rate_hz).round() as usize;
    let of = |signal: &[f64]| PowerSpectrum::of_blocks(&[signal], segment, rate_hz);
    let (a, b) = (of(a), of(b));
    let first = (low_hz / a.step_hz).ceil() as usize;
    let end = (high_hz / a.step_hz) as usize + 1;
    let end = end.min(a.density.len());
    let (mut logs, mut products) = (0.0f64, (0.0f64, 0.0f64, 0.0f64));
    for (a, b) in a
        .density
        // The range may begin above the spectrum.
        .get(first..end)?
        .iter()
        .zip(&b.density[first..end])
    {
        logs += (a.log10() - b.log10()).abs();
        products.0 += (a * b).sqrt();
        products.1 += a;
        products.2 += b;
    }
    let count = end.saturating_sub(first);
    (count > 0 && logs.is_finite()).then(|| Agreement {
        log_power_mae: logs / count as f64,
        fit_coefficient: products.0 / (products.1 * products.2).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::*;
    use super::*;

    #[test]
    fn a_factor_is_its_logarithm_and_no_misfit_and_another_shape_is_one() {
        let signal = noise(20_000, 1);
        let louder = scaled(&signal, 10.0);
        let found = agreement(&signal, &louder, 5000.0, (20.0, 1000.0)).unwrap();
        assert!(close(found.log_power_mae, 2.0, 1e-9));
        assert!(close(found.fit_coefficient, 1.0, 1e-9));
        let other = noise(20_000, 2);
        let of_noise = agreement(&signal, &other, 5000.0, (20.0, 1000.0)).unwrap();
        assert!(of_noise.log_power_mae < 0.15, "{of_noise:?}");
        assert!(of_noise.fit_coefficient > 0.97, "{of_noise:?}");
        let tone: Vec<f64> = sine(20_000, 400.0, 1.0)
            .iter()
            .zip(&other)
            .map(|(t, n)| t + 0.01 * n)
            .collect();
        let of_tone = agreement(&signal, &tone, 5000.0, (20.0, 1000.0)).unwrap();
        assert!(of_tone.fit_coefficient < 0.3, "{of_tone:?}");
        assert_eq!(
            agreement(&signal, &scaled(&signal, 0.0), 5000.0, (20.0, 1000.0)),
            None
        );
        assert_eq!(
            agreement(&signal[..900], &other, 5000.0, (20.0, 1000.0)),
            None
        );
    }
}
