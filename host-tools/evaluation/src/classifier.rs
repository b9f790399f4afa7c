//! A classifier as the judge: how well it distinguishes short windows of recordings from windows of the signals in
//! their place.
//!
//! Each recording and the signal in its place are cut into windows of 250 ms. The features of a window are the levels
//! of its third-octave bands from 31.5 Hz on and, of the signal within these bands, kurtosis, crest factor, and the
//! spread and the largest jump of its 25 ms levels. One logistic regression for all places is fitted to three quarters
//! of the time at each place, and ranks the windows of the fourth quarter. Each quarter is ranked in turn. The area
//! under the ROC curve is the probability that the regression ranks a window of the other signals above a window of the
//! recordings. It is 0.5 if nothing distinguishes them, and 1 if every window of the other signals ranks above all
//! windows of the recordings.

use crate::dsp::fourier::{self, Complex};
use crate::dsp::spectrum::{PowerSpectrum, band_edges_hz};

/// Duration of a window, s.
const WINDOW_S: f64 = 0.25;

/// Levels per window.
const LEVELS: usize = 10;

/// Index of the lowest third-octave band, at 31.5 Hz. A window has eight periods of it.
const FIRST_BAND: usize = 2;

/// Number of parts of the time. Each part is ranked by a classifier that was fitted to the other parts.
const FOLDS: usize = 4;

/// Least number of windows of the recordings: two of each part.
const FEWEST: usize = 2 * FOLDS;

/// Weight of half the sum of the squared coefficients, relative to the mean loss of a window.
const RIDGE: f64 = 0.02;

/// Number of steps of the gradient descent, and their length. The ridge and the standardised features keep the descent
/// stable.
const STEPS: usize = 300;
const STEP: f64 = 0.1;

/// Features of a window.
type Features = Vec<f64>;

/// The windows of a recording and of the signal in its place, in the order of time. Both have the same number of
/// windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Windows([Vec<Features>; 2]);

impl Windows {
    /// Cuts a recording and the signal in its place into whole windows, with features below `high_hz`. Returns `None`
    /// if one of the signals is shorter than 1 s, or silent.
    pub fn of(recorded: &[f64], other: &[f64], rate_hz: f64, high_hz: f64) -> Option<Self> {
        let of = |signal| features(signal, rate_hz, high_hz);
        let (mut recorded, mut other) = (of(recorded)?, of(other)?);
        // A synthesis is longer than its recording, and with all of its windows it would outweigh it in the fit.
        let count = recorded.len().min(other.len());
        recorded.truncate(count);
        other.truncate(count);
        (count >= FOLDS).then_some(Self([recorded, other]))
    }

    fn features(&self) -> usize {
        self.0[0][0].len()
    }

    /// Returns the windows of the recording (`side` 0) or of the other signal (1) that are in part `fold` of the time;
    /// without `is_in`, those that are not.
    fn of_part(&self, side: usize, fold: usize, is_in: bool) -> impl Iterator<Item = &Features> {
        let windows = &self.0[side];
        let indexed = windows.iter().enumerate();
        let own = indexed.filter(move |(at, _)| (at * FOLDS / windows.len() == fold) == is_in);
        own.map(|(_, window)| window)
    }
}

/// Returns the area under the ROC curve over all `places`. Places with fewer bands than others, as at a lower sample
/// rate, are left out. Returns `None` without two seconds of recordings.
pub fn area<'a>(places: impl Iterator<Item = &'a Windows>) -> Option<f64> {
    let mut places: Vec<&Windows> = places.collect();
    // One regression serves all places: fitted to one place, it would find any error of a band there, and every method
    // would score 1. So all windows must have the same features.
    let most = places.iter().map(|windows| windows.features()).max()?;
    places.retain(|windows| windows.features() == most);
    if places
        .iter()
        .map(|windows| windows.0[0].len())
        .sum::<usize>()
        < FEWEST
    {
        return None;
    }
    let areas = (0..FOLDS).map(|fold| {
        let windows = |side: usize, is_in: bool| -> Vec<&Features> {
            let own = places.iter();
            own.flat_map(|place| place.of_part(side, fold, is_in))
                .collect()
        };
        let ranking = Ranking::fitted(&windows(0, false), &windows(1, false));
        let ranks = |side: usize| -> Vec<f64> {
            let own = windows(side, true).into_iter();
            own.map(|window| ranking.score(window)).collect()
        };
        share_above(ranks(0), &ranks(1))
    });
    Some(areas.sum::<f64>() / FOLDS as f64)
}

/// Returns the fraction of all pairs in which the second score is above the first. Pairs of equal scores count half.
fn share_above(mut first: Vec<f64>, second: &[f64]) -> f64 {
    // Sorted once, so that each score of the other side takes two binary searches.
    first.sort_by(f64::total_cmp);
    let below = |score: &f64| {
        let below = first.partition_point(|x| x < score);
        let not_above = first.partition_point(|x| x <= score);
        0.5 * (below + not_above) as f64
    };
    second.iter().map(below).sum::<f64>() / (first.len() * second.len()) as f64
}

/// The features of each whole window; `None` if one is not finite, or if the signal is shorter than 1 s.
fn features(signal: &[f64], rate_hz: f64, high_hz: f64) -> Option<Vec<Features>> {
    let range_hz = (band_edges_hz(FIRST_BAND).0, high_hz);
    let length = (WINDOW_S * rate_hz).round() as usize;
    if signal.len() < FOLDS * length {
        return None;
    }
    let within = within(signal, rate_hz, range_hz);
    let windows = within.chunks_exact(length);
    windows
        .map(|window| of_window(window, rate_hz, high_hz))
        .collect()
}

fn of_window(window: &[f64], rate_hz: f64, high_hz: f64) -> Option<Features> {
    let spectrum = PowerSpectrum::of_blocks(&[window], window.len(), rate_hz);
    let bands = (FIRST_BAND..).map(band_edges_hz);
    // Edges are rounded powers of ten. With this tolerance, a range that ends at an edge includes the band.
    let bands = bands.take_while(|edges| edges.1 <= high_hz * (1.0 + 1e-9));
    let decibels = |power: f64| 10.0 * power.log10();
    let mut features: Features = bands
        .map(|(low, high)| decibels(spectrum.power_between(low, high)))
        .collect();
    let mean_of = |values: &[f64], power: i32| {
        values.iter().map(|x| x.powi(power)).sum::<f64>() / values.len() as f64
    };
    let square = mean_of(window, 2);
    let peak = window.iter().fold(0.0f64, |peak, x| peak.max(x.abs()));
    let levels = window.chunks_exact(window.len() / LEVELS);
    let levels: Vec<f64> = levels.map(|part| decibels(mean_of(part, 2))).collect();
    let middle = mean_of(&levels, 1);
    let spread = levels
        .iter()
        .map(|level| (level - middle).powi(2))
        .sum::<f64>();
    let jumps = levels.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    features.extend([
        (mean_of(window, 4) / square.powi(2)).ln(),
        (peak / square.sqrt()).ln(),
        (spread / LEVELS as f64).sqrt(),
        jumps.fold(0.0, f64::max),
    ]);
    // Silence has levels of minus infinity, which no weight can take.
    features
        .iter()
        .all(|value| value.is_finite())
        .then_some(features)
}

/// The part of `signal` within a range of frequencies.
fn within(signal: &[f64], rate_hz: f64, (low_hz, high_hz): (f64, f64)) -> Vec<f64> {
    let mut spectrum = fourier::forward(&mut signal.to_vec());
    let step_hz = rate_hz / signal.len() as f64;
    for (bin, value) in spectrum.iter_mut().enumerate() {
        let frequency_hz = bin as f64 * step_hz;
        if !(low_hz..=high_hz).contains(&frequency_hz) {
            *value = Complex::default();
        }
    }
    // The inverse transform is not scaled.
    let scale = 1.0 / signal.len() as f64;
    let signal = fourier::inverse(&mut spectrum, signal.len());
    signal.iter().map(|x| scale * x).collect()
}

/// A direction in the space of standardised features.
struct Ranking {
    means: Vec<f64>,
    scales: Vec<f64>,
    weights: Vec<f64>,
}

impl Ranking {
    /// Fits the logistic regression that minimises the sum of mean loss and ridge.
    fn fitted(first: &[&Features], second: &[&Features]) -> Self {
        let windows = || first.iter().chain(second);
        let count = (first.len() + second.len()) as f64;
        let features = first[0].len();
        let mean = |value: &dyn Fn(&[f64]) -> f64| {
            windows().map(|window| value(window)).sum::<f64>() / count
        };
        let means: Vec<f64> = (0..features).map(|at| mean(&|window| window[at])).collect();
        let scale = |at: usize| {
            let deviation = mean(&|window| (window[at] - means[at]).powi(2)).sqrt();
            // A feature that is the same in all windows distinguishes nothing, and would be divided by zero.
            if deviation > 0.0 {
                1.0 / deviation
            } else {
                0.0
            }
        };
        let mut ranking = Self {
            scales: (0..features).map(scale).collect(),
            means,
            weights: vec![0.0; features],
        };
        let labelled = [(first, 0.0), (second, 1.0)];
        let labelled: Vec<(Vec<f64>, f64)> = (labelled.into_iter())
            .flat_map(|(windows, label)| windows.iter().map(move |window| (window, label)))
            .map(|(window, label)| (ranking.standardised(window).collect(), label))
            .collect();
        for _ in 0..STEPS {
            let mut slope: Vec<f64> = ranking.weights.iter().map(|w| RIDGE * w).collect();
            for (window, label) in &labelled {
                let at = dot(&ranking.weights, window.iter().copied());
                let excess = (1.0 / (1.0 + (-at).exp()) - label) / count;
                for (sum, value) in slope.iter_mut().zip(window) {
                    *sum += excess * value;
                }
            }
            for (weight, slope) in ranking.weights.iter_mut().zip(slope) {
                *weight -= STEP * slope;
            }
        }
        ranking
    }

    fn standardised(&self, window: &[f64]) -> impl Iterator<Item = f64> {
        let centred = window.iter().zip(&self.means).map(|(x, mean)| x - mean);
        centred.zip(&self.scales).map(|(x, scale)| scale * x)
    }

    fn score(&self, window: &[f64]) -> f64 {
        dot(&self.weights, self.standardised(window))
    }
}

fn dot(a: &[f64], b: impl Iterator<Item = f64>) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{near, noise};

    const RATE_HZ: f64 = 5_000.0;

    fn windows(recorded: &[f64], other: &[f64]) -> Option<Windows> {
        Windows::of(recorded, other, RATE_HZ, band_edges_hz(17).1)
    }

    /// Returns the area over three places of different levels. `other` makes the second signal from noise like that of
    /// the first.
    fn area_of(other: impl Fn(Vec<f64>) -> Vec<f64>) -> f64 {
        let place = |seed: u64| {
            let level = 4f64.powi(seed as i32 % 3);
            let scaled = |signal: Vec<f64>| signal.iter().map(|x| level * x).collect::<Vec<_>>();
            let another = noise(seed + 100, 20_001);
            windows(&scaled(noise(seed, 20_000)), &scaled(other(another))).unwrap()
        };
        let places: Vec<Windows> = (1..4).map(place).collect();
        area(places.iter()).unwrap()
    }

    #[test]
    fn a_signal_against_itself_and_another_seed_of_its_noise_is_not_told_apart() {
        let signal = noise(1, 40_000);
        let same = windows(&signal, &signal);
        near(area(same.iter()).unwrap(), 0.5, 1e-12);
        let areas: Vec<f64> = (2..22)
            .map(|seed| windows(&noise(seed, 40_000), &noise(seed + 100, 40_000)))
            .map(|windows| area(windows.iter()).unwrap())
            .collect();
        near(areas.iter().sum::<f64>() / 20.0, 0.5, 0.06);
    }

    #[test]
    fn another_shape_and_a_level_that_comes_and_goes_are_told_apart_at_any_level() {
        let higher = |x: Vec<f64>| x.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let swelling = |n: usize| 1.0 + 0.9 * (n as f64 / 80.0).sin();
        let alive = |x: Vec<f64>| {
            let indexed = x.iter().enumerate();
            indexed.map(|(n, x)| swelling(n) * x / 1.185).collect()
        };
        let (same, shape, level) = (area_of(|x| x), area_of(higher), area_of(alive));
        assert!((0.3..0.7).contains(&same), "{same}");
        assert!(shape > 0.95 && level > 0.95, "{shape} {level}");
    }

    #[test]
    fn silence_and_what_is_too_short_has_no_area() {
        let signal = noise(1, 40_000);
        assert_eq!(windows(&signal[..4_999], &signal), None);
        assert_eq!(windows(&signal, &vec![0.0; 40_000]), None);
        let short = windows(&signal[..5_000], &signal).unwrap();
        assert_eq!(area([&short].into_iter()), None);
        assert!(area([&short, &short].into_iter()).is_some());
    }
}
