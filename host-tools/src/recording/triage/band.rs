//! Verdicts on the spectrum of a trial: slow motion, a band without a signal, the noise of a sensor alone.

use model_format::SAMPLE_RATE_HZ;

use super::verdict::{SLOW_HZ, Verdict};
use crate::dsp::spectrum::PowerSpectrum;
use crate::dsp::sums::{Moments, energy, sum_of};
use crate::dsp::wide;

/// Least share of the energy below [`SLOW_HZ`] of a wandering trial. A fit spends its first coefficients on it then.
const SLOW_SHARE: f64 = 0.25;

/// Width of a band, Hz.
const BAND_HZ: f64 = 50.0;

/// Lowest and highest frequency at which a band without a signal may begin, and the end of what is looked at: the
/// resampler's own edge is above it; Hz.
const EDGE_FROM_HZ: f64 = 250.0;
const EDGE_TO_HZ: f64 = 2000.0;
const LOOK_TO_HZ: f64 = 2200.0;

/// Bands of an edge, and the bands on either side whose median is its height.
const EDGE_BANDS: usize = 2;
const SIDE_BANDS: usize = 3;

/// Least height of an edge, dB. The steepest 100 Hz of real takes fall by 8 dB; the last line of a weave stands 31 dB
/// above the noise of the simulated rig's sensor.
const EDGE_DB: f64 = 40.0;

/// Largest fall of the level from behind the edge to the end, dB. A slope that goes on falling is a texture's own.
const FLOOR_FALL_DB: f64 = 12.0;

/// Largest standard deviation of a white spectrum's bands, dB, for 2 s; that of white noise is 0.5 dB.
const WHITE_SPREAD_DB: f64 = 1.2;

/// Bounds of the kurtosis of Gaussian noise: 3, and six standard deviations of its estimate from 2 s.
const GAUSSIAN: core::ops::Range<f64> = 2.7..3.3;

/// Largest RMS of a sensor's own noise, m/s²: 300 µg/√Hz, as of coarse accelerometers, over 2.5 kHz, is 0.15 m/s².
pub const SENSOR_NOISE_M_S2: f64 = 0.2;

/// Samples of a trial that can be judged: 0.4 s.
const LEAST_SAMPLES: usize = 2000;

/// Returns the verdicts on the spectra of `axes` together, which come with their moments, from a file of
/// `source_rate_hz`.
pub(super) fn verdicts(
    (axes, moments): (&[Vec<f64>], &[Moments]),
    source_rate_hz: f64,
) -> Vec<Verdict> {
    let samples = axes.first().map_or(0, Vec::len);
    if samples < LEAST_SAMPLES {
        return Vec::new();
    }
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let centred: Vec<Vec<f64>> = (axes.iter().zip(moments))
        .map(|(axis, moments)| axis.iter().map(|x| x - moments.mean).collect())
        .collect();
    let spectra: Vec<PowerSpectrum> = centred
        .iter()
        .map(|axis| PowerSpectrum::welch(axis, rate_hz))
        .collect();
    let between = |low_hz: f64, high_hz: f64| -> f64 {
        spectra
            .iter()
            .map(|spectrum| spectrum.power_between(low_hz, high_hz))
            .sum()
    };
    let mut verdicts = Vec::new();
    let share = between(0.0, SLOW_HZ) / between(0.0, 0.5 * rate_hz);
    if share >= SLOW_SHARE {
        verdicts.push(Verdict::Wandering { share });
    }
    let bands: Vec<f64> = (0..(LOOK_TO_HZ / BAND_HZ) as usize)
        .map(|band| between(band as f64 * BAND_HZ, (band + 1) as f64 * BAND_HZ))
        .map(|power| 10.0 * power.max(f64::MIN_POSITIVE).log10())
        .collect();
    // A file of a lower rate has an edge of its own, which another verdict tells.
    if source_rate_hz >= rate_hz {
        verdicts.extend(edge(&bands));
    }
    verdicts.extend(sensor_noise(&centred, &bands));
    verdicts
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// The highest edge with nothing but a floor behind it.
fn edge(bands: &[f64]) -> Option<Verdict> {
    let last = (EDGE_TO_HZ / BAND_HZ) as usize;
    let first = (EDGE_FROM_HZ / BAND_HZ) as usize;
    let height = |at: usize| {
        let behind = &bands[at + EDGE_BANDS..];
        median(&bands[at - SIDE_BANDS..at]) - behind.iter().copied().fold(f64::MIN, f64::max)
    };
    let at = (first..last).max_by(|&a, &b| height(a).total_cmp(&height(b)))?;
    let behind = &bands[at + EDGE_BANDS..];
    let fall = median(&behind[..SIDE_BANDS.min(behind.len())])
        - median(&behind[behind.len() - SIDE_BANDS.min(behind.len())..]);
    (height(at) >= EDGE_DB && fall <= FLOOR_FALL_DB).then(|| Verdict::EmptyBand {
        above_hz: (at + EDGE_BANDS / 2) as f64 * BAND_HZ,
        edge_db: height(at),
    })
}

/// White, Gaussian and weak on every axis.
fn sensor_noise(centred: &[Vec<f64>], bands: &[f64]) -> Option<Verdict> {
    let powers: Vec<f64> = (centred.iter())
        .map(|axis| energy(axis) / axis.len() as f64)
        .collect();
    let rms_m_s2 = powers.iter().sum::<f64>().sqrt();
    // A surface is louder, and needs no more sums.
    if rms_m_s2 > SENSOR_NOISE_M_S2 {
        return None;
    }
    let fourth = |axis: &[f64]| {
        let sum = wide(
            #[inline(always)]
            || sum_of(axis, |x| (x * x) * (x * x)),
        );
        sum / axis.len() as f64
    };
    let gaussian = centred
        .iter()
        .zip(&powers)
        .all(|(axis, &power)| power <= 0.0 || GAUSSIAN.contains(&(fourth(axis) / (power * power))));
    // The lowest band loses what the window and the mean take from it.
    let bands = &bands[1..];
    let mean = bands.iter().sum::<f64>() / bands.len() as f64;
    let square = bands
        .iter()
        .map(|band| (band - mean) * (band - mean))
        .sum::<f64>();
    let white = (square / bands.len() as f64).sqrt() <= WHITE_SPREAD_DB;
    (gaussian && white).then_some(Verdict::SensorNoise { rms_m_s2 })
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, noise, plus, tone};
    use super::*;
    use crate::dsp::sums::moments;

    fn verdicts(axes: &[Vec<f64>], source_rate_hz: f64) -> Vec<Verdict> {
        let moments: Vec<_> = axes.iter().map(|axis| moments(axis)).collect();
        super::verdicts((axes, &moments), source_rate_hz)
    }

    fn gaussian(seed: u64, rms: f64) -> Vec<f64> {
        let sum = (0..12)
            .map(|part| noise(100 * seed + part))
            .fold(vec![0.0; 10_000], |sum, part| plus(&sum, part.into_iter()));
        let scale = rms / 8f64.sqrt();
        sum.iter().map(|x| scale * x).collect()
    }

    #[test]
    fn noise_of_a_sensor_is_told_from_loud_and_from_coloured_noise() {
        assert!(matches!(
            verdicts(&[gaussian(1, 0.05)], RATE_HZ)[..],
            [Verdict::SensorNoise { .. }]
        ));
        assert_eq!(verdicts(&[gaussian(2, 1.0)], RATE_HZ), []);
        let coloured: Vec<f64> = gaussian(3, 0.05)
            .windows(2)
            .map(|pair| pair[0] + 0.7 * pair[1])
            .collect();
        assert_eq!(verdicts(&[coloured], RATE_HZ), []);
    }

    #[test]
    fn an_empty_band_is_told_from_a_slope() {
        let lines = |fall: f64| {
            let floor: Vec<f64> = noise(5).iter().map(|x| 1e-5 * x).collect();
            (1..220).fold(floor, |sum, step| {
                let frequency_hz = 10.0 * f64::from(step) + 0.3;
                plus(
                    &sum,
                    tone(frequency_hz, (frequency_hz / 300.0).max(1.0).powf(-fall)),
                )
            })
        };
        assert_eq!(verdicts(&[lines(8.0)], RATE_HZ), []);
        let mut band = noise(5).iter().map(|x| 1e-4 * x).collect::<Vec<f64>>();
        for step in 1..100 {
            band = plus(&band, tone(10.0 * f64::from(step) + 0.3, 1.0));
        }
        let found = verdicts(&[band], RATE_HZ);
        assert!(
            matches!(found[..], [Verdict::EmptyBand { above_hz, .. }] if (above_hz - 1000.0).abs() <= 100.0),
            "{found:?}"
        );
    }
}
