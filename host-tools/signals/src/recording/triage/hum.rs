//! Lines at mains frequencies, and which of them are hum.

use std::fmt;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};
use stylus_dsp::autocorrelation::PaddedSpectrum;
use stylus_dsp::fourier::Complex;
use stylus_dsp::sums::upper_median;

/// Least level of a mains line above its surroundings, and of the axis that alone has it above the others, dB.
pub const HUM_RATIO_DB: f64 = 20.0;

/// Mains frequencies with their second and third harmonics, Hz. Rectifiers and magnets hum at twice the mains
/// frequency.
const MAINS_HZ: [f64; 6] = [50.0, 60.0, 100.0, 120.0, 150.0, 180.0];

/// Largest deviation of a line from a mains frequency, Hz.
const NEAR_HZ: f64 = 1.0;

/// Distances from a mains frequency between which its surroundings lie, Hz.
const AROUND_HZ: (f64, f64) = (3.0, 10.0);

/// Relative error of the speeds in a list.
const SPEED_ERROR: f64 = 0.02;

/// A line at a mains frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MainsLine {
    /// Frequency, Hz.
    hz: f64,
    /// Number of the axis, from 1, that alone has the line.
    axis: Option<usize>,
}

impl fmt::Display for MainsLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at {:.1} Hz", self.hz)?;
        self.axis.map_or(Ok(()), |axis| {
            write!(f, " on axis {axis} alone, which --reduce with another axis leaves out")
        })
    }
}

/// Returns the mains lines in the spectrum of a trial that was reduced from `axes` and holds the band `held`, Hz. At
/// the edges of that band, the spectrum falls as beside a line.
///
/// At one speed, a line of the texture can coincide with a mains frequency; trials at other speeds tell the two apart.
pub fn mains_lines(spectrum: &PaddedSpectrum, axes: &[Vec<f64>], held: &Range<f64>) -> Vec<MainsLine> {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / spectrum.transform_length as f64;
    let power = &spectrum.power;
    let bins = |from_hz: f64, to_hz: f64| {
        let from = (from_hz.max(held.start) / bin_hz).round() as usize;
        let to = ((to_hz.min(held.end) / bin_hz).round() as usize).min(power.len());
        from.min(to)..to
    };
    let is_held = |mains: &f64| held.start <= mains - NEAR_HZ && mains + NEAR_HZ <= held.end;
    MAINS_HZ
        .into_iter()
        .filter(is_held)
        .filter_map(|mains| {
            let line = bins(mains - NEAR_HZ, mains + NEAR_HZ);
            let peak = line.max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
            let around: Vec<f64> = bins(mains - AROUND_HZ.1, mains - AROUND_HZ.0)
                .chain(bins(mains + AROUND_HZ.0, mains + AROUND_HZ.1))
                .map(|bin| power[bin])
                .collect();
            let median = upper_median(&around)?;
            let hz = peak as f64 * bin_hz;
            (power[peak] > ratio() * median).then(|| MainsLine {
                hz,
                axis: lone_axis(axes, hz),
            })
        })
        .collect()
}

/// Ratio of powers of [`HUM_RATIO_DB`].
fn ratio() -> f64 {
    10f64.powf(HUM_RATIO_DB / 10.0)
}

/// Returns the number of the one of `axes` that alone has the line at `hz`.
fn lone_axis(axes: &[Vec<f64>], hz: f64) -> Option<usize> {
    let step = std::f64::consts::TAU * hz / f64::from(SAMPLE_RATE_HZ);
    let power = |axis: &Vec<f64>| {
        (0u32..)
            .zip(axis)
            .map(|(n, x)| Complex::cis(step * f64::from(n)) * *x)
            .sum::<Complex<f64>>()
            .norm_sqr()
    };
    let powers: Vec<f64> = axes.iter().map(power).collect();
    let (strongest, most) = (1..).zip(&powers).max_by(|a, b| a.1.total_cmp(b.1))?;
    let others = powers.iter().sum::<f64>() - most;
    (axes.len() > 1 && *most > ratio() * others).then_some(strongest)
}

/// Returns the confirmed mains line of each trial of a texture. Trials are given as speed, mm/s, and mains lines.
///
/// Hum keeps its frequency while the speed changes. A line is hum if half of the speeds or more have one at its
/// frequency, and no wavelength explains lines at more speeds. With one or two speeds, one that has it is enough.
pub(super) fn confirmed_hum(trials: &[(f64, &[MainsLine])]) -> Vec<Option<MainsLine>> {
    // The number of speeds with a line at the frequency for the speed, whose relative error is given.
    let speeds = |hz_at: &dyn Fn(f64) -> f64, error: f64| {
        let has = |speed: f64, line: &MainsLine| (line.hz - hz_at(speed)).abs() <= NEAR_HZ + error * line.hz;
        let with = trials
            .iter()
            .filter(|(speed, lines)| lines.iter().any(|line| has(*speed, line)));
        distinct(with.map(|(speed, _)| *speed))
    };
    let all = distinct(trials.iter().map(|(speed, _)| *speed));
    let per_mm = trials
        .iter()
        .flat_map(|(speed, lines)| lines.iter().map(move |line| line.hz / speed));
    let moving = per_mm
        .map(|per_mm| speeds(&|speed| per_mm * speed, SPEED_ERROR))
        .max()
        .unwrap_or(0);
    let is_hum = |line: &&MainsLine| {
        let staying = speeds(&|_| line.hz, 0.0);
        staying >= moving && (all <= 2 || 2 * staying >= all)
    };
    trials
        .iter()
        .map(|(_, lines)| lines.iter().find(is_hum).copied())
        .collect()
}

/// Returns the number of different values.
fn distinct(values: impl Iterator<Item = f64>) -> usize {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values.len()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{bounded_noise, plus, tone};
    use super::*;
    use crate::recording::resample;

    const ALL: Range<f64> = 0.0..f64::INFINITY;

    fn lines_of(signal: &[f64], held: &Range<f64>) -> Vec<f64> {
        mains_lines(&PaddedSpectrum::of(signal, 400), &[signal.to_vec()], held)
            .iter()
            .map(|line| line.hz)
            .collect()
    }

    #[test]
    fn mains_lines_are_found_with_their_frequency_and_others_are_not() {
        for frequency_hz in [50.0, 59.9, 100.0, 119.8, 150.2, 180.0] {
            let found = lines_of(&plus(&bounded_noise(7), tone(frequency_hz, 0.3)), &ALL);
            assert!(found.len() == 1 && (found[0] - frequency_hz).abs() < 0.5, "{found:?}");
        }
        assert!(lines_of(&plus(&bounded_noise(8), tone(70.0, 0.5)), &ALL).is_empty());
        assert!(lines_of(&vec![0.0; 10_000], &ALL).is_empty());
    }

    #[test]
    fn the_edge_of_a_recordings_band_is_no_line_and_a_line_within_the_band_is_one() {
        for rate_hz in [100, 104, 120, 125, 200, 208, 250, 300, 360, 400] {
            let lines_with = |amplitude: f64| {
                // The helper's tone is one at 5 kHz.
                let ratio = f64::from(SAMPLE_RATE_HZ) / f64::from(rate_hz);
                let mut own = plus(&bounded_noise(u64::from(rate_hz)), tone(50.0 * ratio, amplitude));
                own.truncate(20 * rate_hz as usize);
                let there = resample(&[own], rate_hz, SAMPLE_RATE_HZ).remove(0);
                lines_of(&there, &(0.0..0.45 * f64::from(rate_hz)))
            };
            assert!(lines_with(0.0).is_empty(), "{rate_hz} Hz: {:?}", lines_with(0.0));
            let found = lines_with(1.0);
            let is_it = found.len() == 1 && (found[0] - 50.0).abs() < 0.1;
            assert_eq!(is_it, 0.45 * f64::from(rate_hz) > 51.0, "{rate_hz} Hz: {found:?}");
        }
    }

    fn lines(frequencies_hz: &[f64]) -> Vec<MainsLine> {
        frequencies_hz.iter().map(|&hz| MainsLine { hz, axis: None }).collect()
    }

    /// The frequencies that count as hum, of trials with these speeds and mains lines.
    fn hum(trials: &[(f64, Vec<MainsLine>)]) -> Vec<Option<f64>> {
        let trials: Vec<_> = trials.iter().map(|(speed, lines)| (*speed, &lines[..])).collect();
        confirmed_hum(&trials).into_iter().map(|line| Some(line?.hz)).collect()
    }

    #[test]
    fn hum_keeps_its_frequency_while_the_speed_changes() {
        let speeds = [40.0, 50.0, 60.0, 80.0];
        let own = speeds.map(|v| (v, lines(&[v][..usize::from(v == 50.0)])));
        assert_eq!(hum(&own), [None; 4]);
        let mains = speeds.map(|v| (v, lines(&[50.1])));
        assert_eq!(hum(&mains), [Some(50.1); 4]);
        assert_eq!(hum(&[(100.0, lines(&[60.0]))]), [Some(60.0)]);
        // With harmonics, at speeds at which they could be a grating's, too.
        let harmonics = [50.0, 100.0, 150.0].map(|v| (v, lines(&[50.0, 100.0, 150.0])));
        assert_eq!(hum(&harmonics), [Some(50.0); 3]);
    }

    #[test]
    fn a_grating_that_passes_mains_frequencies_is_no_hum() {
        // 1 mm: with the fundamental alone, and with all harmonics.
        let plain = [60.0, 120.0, 180.0, 240.0].map(|v| (v, lines(&[v][..usize::from(v < 200.0)])));
        assert_eq!(hum(&plain), [None; 4]);
        let harmonics = [(60.0, &[60.0, 120.0, 180.0][..]), (120.0, &[120.0]), (180.0, &[180.0])];
        assert_eq!(hum(&harmonics.map(|(v, hz)| (v, lines(hz)))), [None; 3]);
        // Two speeds, as they were measured.
        assert_eq!(hum(&[(50.4, lines(&[50.2])), (99.2, lines(&[99.6]))]), [None; 2]);
    }

    #[test]
    fn an_axis_that_alone_has_the_hum_is_named() {
        let axes = [
            bounded_noise(1),
            bounded_noise(2),
            plus(&bounded_noise(3), tone(50.0, 2.0)),
        ];
        let sum = plus(&axes[0], axes[2].iter().copied());
        let found = mains_lines(&PaddedSpectrum::of(&sum, 400), &axes, &ALL);
        let words = found[0].to_string();
        assert!(words.starts_with("at 50.0 Hz on axis 3 alone"), "{words}");
        let all = [1.0, 0.3, 0.2].map(|gain| plus(&bounded_noise(4), tone(50.0, 3.0 * gain)));
        let found = mains_lines(&PaddedSpectrum::of(&all[0], 400), &all, &ALL);
        assert_eq!(found[0].axis, None);
    }
}
