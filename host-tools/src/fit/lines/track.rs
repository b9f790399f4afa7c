//! The place of the surface under the tool, sample by sample, as the lines of the recording itself tell it.
//!
//! A list gives one speed per trial. Where the actual one wanders, the phase of the strongest line does, and all lines
//! of the surface with it.

use std::f64::consts::TAU;

use model_format::SAMPLE_RATE_HZ;
use realfft::num_complex::Complex;

use super::peaks::hann;

/// Duration over which a line's phase is averaged, s. Speeds that change faster are not followed.
const AVERAGE_S: f64 = 0.2;

/// RMS by which a line's phase leaves a straight course before it is followed, rad; less leaves a residue 34 dB below
/// the line.
const LEAST_WANDER_RAD: f64 = 0.02;

/// The same, over what noise alone makes of a straight course: to follow noise takes it away.
const LEAST_WANDER_OVER_NOISE: f64 = 3.0;

/// Least power of a line over the noise beside it, both averaged, for its phase to be followed.
const LEAST_RATIO: f64 = 20.0;

/// Relative deviation of a line's amplitude, per rad of its phase's, beyond which it is two lines that beat.
const MOST_BEAT: f64 = 0.35;

/// Place at each sample, mm, at a steady speed.
pub(super) fn steady_mm(speed_mm_s: f64, samples: usize) -> Vec<f64> {
    let step = speed_mm_s / f64::from(SAMPLE_RATE_HZ);
    (0..samples).map(|n| step * n as f64).collect()
}

/// Phase of a line at each sample, turns.
pub(super) fn turns(place_mm: &[f64], wavelength_mm: f64) -> Vec<f64> {
    place_mm.iter().map(|x| x / wavelength_mm).collect()
}

/// Corrects `place_mm` by the phase of the line of `wavelength_mm`, if that wanders and is clear enough. Returns the
/// RMS wander of the speed over its mean, if it was corrected.
pub(super) fn followed(signal: &[f64], place_mm: &mut [f64], wavelength_mm: f64) -> Option<f64> {
    let samples = signal.len();
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let window = ((AVERAGE_S * rate_hz) as usize).min(samples / 4);
    if window < 8 {
        return None;
    }
    let hop = window / 8;
    let down: Vec<Complex<f64>> = signal
        .iter()
        .zip(place_mm.iter())
        .map(|(x, place)| x * Complex::cis(-TAU * (place / wavelength_mm).fract()))
        .collect();
    let weights: Vec<f64> = (0..window).map(|n| hann(n, window)).collect();
    let sum = weights.iter().sum::<f64>();
    let centres: Vec<usize> = (0..=(samples - window) / hop).map(|k| k * hop).collect();
    let phasors: Vec<Complex<f64>> = centres
        .iter()
        .map(|&start| {
            let terms = down[start..start + window].iter().zip(&weights);
            2.0 / sum * terms.map(|(z, w)| z * *w).sum::<Complex<f64>>()
        })
        .collect();
    let power = phasors.iter().map(Complex::norm_sqr).sum::<f64>() / phasors.len() as f64;
    // Beside the line, as far off as the window separates: the noise in the same average.
    let beside = |offset_hz: f64| -> f64 {
        let terms = centres.iter().map(|&start| {
            let turned = (start..start + window).zip(&weights).map(|(n, w)| {
                down[n] * *w * Complex::cis(-TAU * (offset_hz * n as f64 / rate_hz).fract())
            });
            (2.0 / sum * turned.sum::<Complex<f64>>()).norm_sqr()
        });
        terms.sum::<f64>() / centres.len() as f64
    };
    let offset_hz = 6.0 * rate_hz / window as f64;
    let noise = beside(offset_hz)
        .max(beside(-offset_hz))
        .max(f64::MIN_POSITIVE);
    if power < LEAST_RATIO * noise {
        return None;
    }
    let phases = unwrapped(&phasors);
    let times: Vec<f64> = centres
        .iter()
        .map(|&start| (start + window / 2) as f64)
        .collect();
    let wander = rms(&without_straight_line(&times, &phases));
    // A phase in noise wanders by the noise alone.
    let by_noise = (0.5 * noise / power).sqrt();
    if wander < LEAST_WANDER_RAD.max(LEAST_WANDER_OVER_NOISE * by_noise) {
        return None;
    }
    // Two lines close together beat: their phase wanders, and their amplitude as much. A wandering speed leaves the
    // amplitude alone.
    let lengths: Vec<f64> = phasors.iter().map(|phasor| phasor.norm()).collect();
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    let deviations: Vec<f64> = lengths.iter().map(|length| length / mean - 1.0).collect();
    if rms(&deviations) > MOST_BEAT * wander.min(1.0) + 2.0 * by_noise {
        return None;
    }
    let corrections: Vec<f64> = phases
        .iter()
        .map(|phase| phase / TAU * wavelength_mm)
        .collect();
    let path_mm = place_mm[samples - 1] - place_mm[0];
    let mut speeds = Vec::with_capacity(corrections.len());
    for pair in corrections.windows(2) {
        speeds.push((pair[1] - pair[0]) / hop as f64 / (path_mm / (samples - 1) as f64));
    }
    for (n, place) in place_mm.iter_mut().enumerate() {
        *place += interpolated(&times, &corrections, n as f64);
    }
    let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let deviations: Vec<f64> = speeds.iter().map(|s| s - mean).collect();
    Some(rms(&deviations))
}

fn unwrapped(phasors: &[Complex<f64>]) -> Vec<f64> {
    let mut phase = 0.0;
    let mut last: Option<Complex<f64>> = None;
    phasors
        .iter()
        .map(|phasor| {
            phase = match last {
                Some(last) => phase + (phasor * last.conj()).arg(),
                None => phasor.arg(),
            };
            last = Some(*phasor);
            phase
        })
        .collect()
}

/// Values of a table at ascending places; straight on beyond its ends.
fn interpolated(places: &[f64], values: &[f64], at: f64) -> f64 {
    if places.len() < 2 {
        return values.first().copied().unwrap_or(0.0);
    }
    let right = places
        .partition_point(|&place| place <= at)
        .clamp(1, places.len() - 1);
    let share = (at - places[right - 1]) / (places[right] - places[right - 1]);
    values[right - 1] + share * (values[right] - values[right - 1])
}

fn without_straight_line(times: &[f64], values: &[f64]) -> Vec<f64> {
    let count = times.len() as f64;
    let (mean_t, mean_v) = (
        times.iter().sum::<f64>() / count,
        values.iter().sum::<f64>() / count,
    );
    let (mut product, mut square) = (0.0, 0.0);
    for (t, v) in times.iter().zip(values) {
        product += (t - mean_t) * (v - mean_v);
        square += (t - mean_t).powi(2);
    }
    let slope = if square > 0.0 { product / square } else { 0.0 };
    let left = times.iter().zip(values);
    left.map(|(t, v)| v - mean_v - slope * (t - mean_t))
        .collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Samples of `signal` where its ascending `places` are multiples of `step`, by a cubic through four samples: exact
/// enough to find a line, which is then fitted to the samples themselves.
pub(super) fn at_even_places(signal: &[f64], places: &[f64], step: f64) -> Vec<f64> {
    let last = signal.len() - 1;
    let at = |index: isize| signal[index.clamp(0, last as isize) as usize];
    let mut before = 0;
    (0..signal.len())
        .map(|n| {
            let place = step * n as f64;
            while before + 2 < places.len() && places[before + 1] <= place {
                before += 1;
            }
            let gap = places[before + 1] - places[before];
            let share = ((place - places[before]) / gap).clamp(-1.0, 2.0);
            let i = before as isize;
            let (a, b, c, d) = (at(i - 1), at(i), at(i + 1), at(i + 2));
            // Catmull and Rom's spline.
            let (first, second) = (0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d);
            let third = 0.5 * (d - a) + 1.5 * (b - c);
            b + share * (first + share * (second + share * third))
        })
        .collect()
}
