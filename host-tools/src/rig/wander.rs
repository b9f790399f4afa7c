//! Wander of the drum's speed: the place under the tip as it leaves its even course.
//!
//! The vibration is computed over place at the trial's nominal speed, four points per sample, and read at the places
//! where the tip is. The tool's response stays that of the nominal speed, from which a wander of some percent moves a
//! line by less than a resonance is wide.

use std::f64::consts::{PI, TAU};

use rand::RngExt;
use rand_distr::StandardNormal;

use super::description::Wander;
use super::random::StreamKey;

/// Sines that a wander consists of.
const SINES: usize = 48;

/// Points of the vibration per sample.
pub(super) const POINTS_PER_SAMPLE: usize = 4;

/// Points on each side of a place that its value is interpolated from.
const REACH: usize = 16;

/// Place at each sample, in samples of the nominal speed.
pub(super) fn places(
    wander: &Wander,
    sample_rate_hz: f64,
    key: StreamKey,
    samples: usize,
) -> Vec<f64> {
    let mut random = key.stream("wander");
    let mut speed = vec![1.0; samples];
    let scale = wander.rms / (SINES as f64).sqrt();
    for _ in 0..SINES {
        // A Gaussian correlation over time has a Gaussian spectrum.
        let position: f64 = random.sample(StandardNormal);
        let frequency_hz = position / (TAU * wander.correlation_s);
        let (cosine, sine): (f64, f64) =
            (random.sample(StandardNormal), random.sample(StandardNormal));
        for (n, speed) in speed.iter_mut().enumerate() {
            let angle = TAU * (frequency_hz * n as f64 / sample_rate_hz).fract();
            *speed += scale * (cosine * angle.cos() + sine * angle.sin());
        }
    }
    let mut place = 0.0;
    speed
        .into_iter()
        .map(|speed| {
            let here = place;
            place += speed;
            here
        })
        .collect()
}

/// First point that is needed for `places`, in points, and the number of points.
pub(super) fn points(places: &[f64]) -> (i64, usize) {
    let (low, high) = places
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
    let (reach, per_sample) = (REACH as i64, POINTS_PER_SAMPLE as f64);
    let first = (low * per_sample).floor() as i64 - reach;
    let last = (high * per_sample).ceil() as i64 + reach;
    (first, (last - first + 1) as usize)
}

/// Values at `places` of a function that is known at points from `first` on.
pub(super) fn read(values: &[f64], first: i64, places: &[f64]) -> Vec<f64> {
    places
        .iter()
        .map(|place| {
            let at = place * POINTS_PER_SAMPLE as f64 - first as f64;
            let before = at.floor() as usize;
            (before + 1 - REACH..=before + REACH)
                .map(|point| values[point] * windowed_sinc(at - point as f64))
                .sum()
        })
        .collect()
}

/// Sinc with a Hann window over [`REACH`] points on each side.
fn windowed_sinc(x: f64) -> f64 {
    let window = 0.5 + 0.5 * (PI * x / REACH as f64).cos();
    if x.abs() < 1e-9 {
        return window;
    }
    window * (PI * x).sin() / (PI * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WANDER: Wander = Wander {
        rms: 0.01,
        correlation_s: 0.2,
    };

    proptest! {
        #[test]
        fn a_sine_over_place_is_read_where_the_tip_is(cycles_per_sample in 0.001..0.45_f64, seed in 0u64..1000) {
            let places = places(&WANDER, 5000.0, StreamKey::new(seed), 2000);
            let (first, count) = points(&places);
            let sine = |place: f64| (TAU * cycles_per_sample * place).sin();
            let values: Vec<f64> = (0..count)
                .map(|point| sine((first + point as i64) as f64 / POINTS_PER_SAMPLE as f64))
                .collect();
            for (value, place) in read(&values, first, &places).iter().zip(&places) {
                prop_assert!((value - sine(*place)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_speed_wanders_by_as_much_as_is_named() {
        let samples = 400_000;
        let places = places(&WANDER, 5000.0, StreamKey::new(3), samples);
        let deviations = places
            .windows(2)
            .map(|pair| (pair[1] - pair[0] - 1.0).powi(2));
        let rms = (deviations.sum::<f64>() / (samples - 1) as f64).sqrt();
        assert!((rms / WANDER.rms - 1.0).abs() < 0.3, "{rms}");
    }
}
