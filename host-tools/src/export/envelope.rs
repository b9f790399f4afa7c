//! A stroke as one tone of varying amplitude and frequency: all that an envelope format can hold of it.

use std::f64::consts::{SQRT_2, TAU};

/// Time between two points, s.
const STEP_S: f64 = 0.02;

/// Frequencies of the normalised values 0 and 1, Hz. The formats name none; these are what MPEG's reference software
/// takes for AHAP's sharpness.
pub const RANGE_HZ: (f64, f64) = (65.0, 300.0);

/// The tone at one time.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub time_s: f64,
    pub amplitude_m_s2: f64,
    pub frequency_hz: f64,
}

/// The tone at times that rise from 0 to the stroke's end; between them, amplitude and frequency are linear.
#[derive(Clone, Debug)]
pub struct Envelope {
    pub points: Vec<Point>,
}

impl Envelope {
    /// The tone with the power and the mean frequency of `samples` in 40 ms around each point.
    ///
    /// The mean frequency is that of a sine with the same correlation between neighbouring samples, within [`RANGE_HZ`].
    pub fn of(samples: &[f64], rate_hz: f64) -> Self {
        let step = ((rate_hz * STEP_S).round() as usize).max(1);
        let point = |index: usize| {
            let middle = (index * step).min(samples.len());
            let end = (middle + step).min(samples.len());
            let window = &samples[middle.saturating_sub(step)..end];
            let power: f64 = window.iter().map(|x| x * x).sum();
            let neighbours: f64 = window.windows(2).map(|pair| pair[0] * pair[1]).sum();
            let mean_hz = (neighbours / power).clamp(-1.0, 1.0).acos() * rate_hz / TAU;
            Point {
                time_s: middle as f64 / rate_hz,
                amplitude_m_s2: SQRT_2 * (power / window.len() as f64).sqrt(),
                // Of silence the ratio is no number, which `max` leaves out.
                frequency_hz: mean_hz.max(RANGE_HZ.0).min(RANGE_HZ.1),
            }
        };
        Self {
            points: (0..=samples.len().div_ceil(step)).map(point).collect(),
        }
    }

    /// The first `count` samples of the tone, m/s².
    pub fn tone(&self, count: usize, rate_hz: f64) -> Vec<f64> {
        let (mut segment, mut phase) = (0, 0.0f64);
        let sample = |n: usize| {
            let time_s = n as f64 / rate_hz;
            while segment + 2 < self.points.len() && self.points[segment + 1].time_s <= time_s {
                segment += 1;
            }
            let (from, to) = (self.points[segment], self.points[segment + 1]);
            let share = (time_s - from.time_s) / (to.time_s - from.time_s);
            let between = |from: f64, to: f64| from + share * (to - from);
            let value = between(from.amplitude_m_s2, to.amplitude_m_s2) * phase.sin();
            phase += TAU * between(from.frequency_hz, to.frequency_hz) / rate_hz;
            value
        };
        (0..count).map(sample).collect()
    }
}

impl Point {
    /// Returns the amplitude as a share of `full_scale_m_s2`, and the place of the frequency within [`RANGE_HZ`].
    pub fn normalised(&self, full_scale_m_s2: f64) -> (f64, f64) {
        let (low_hz, high_hz) = RANGE_HZ;
        (
            self.amplitude_m_s2 / full_scale_m_s2,
            (self.frequency_hz - low_hz) / (high_hz - low_hz),
        )
    }
}
