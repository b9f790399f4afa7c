//! A stroke as one tone of varying amplitude and frequency. Meta's `.haptic` and Apple's AHAP cannot contain more.

use std::f64::consts::{SQRT_2, TAU};

use serde_json::{Value, json};

/// Time between two points, s.
const STEP_S: f64 = 0.02;

/// Frequencies of the formats' values 0 and 1, Hz. The formats do not specify them; MPEG's reference software uses
/// these for AHAP's sharpness.
pub const RANGE_HZ: (f64, f64) = (65.0, 300.0);

/// Longest event that AHAP allows, s.
const MAX_EVENT_S: f64 = 30.0;

/// Number of segments of a curve of AHAP, which has at most 16 points. The next curve begins with the last point.
const SEGMENTS: usize = 15;

/// The tone at one time.
#[derive(Debug)]
struct Point {
    time_s: f64,
    amplitude_m_s2: f64,
    frequency_hz: f64,
}

/// The tone at ascending times from 0 to the stroke's end. Between them, amplitude and frequency are interpolated
/// linearly.
#[derive(Debug)]
pub struct Envelope(Vec<Point>);

impl Envelope {
    /// Creates the tone whose power and mean frequency are those of `samples` in the 40 ms around each point.
    ///
    /// The mean frequency is the frequency of a sine with the same correlation of neighbouring samples, limited to
    /// [`RANGE_HZ`].
    pub fn of(samples: &[f64], rate_hz: f64) -> Self {
        let step = ((rate_hz * STEP_S).round() as usize).max(1);
        let point = |index: usize| {
            let middle = (index * step).min(samples.len());
            let window = &samples[middle.saturating_sub(step)..(middle + step).min(samples.len())];
            let power: f64 = window.iter().map(|x| x * x).sum();
            let neighbours: f64 = window.windows(2).map(|pair| pair[0] * pair[1]).sum();
            let mean_hz = (neighbours / power).clamp(-1.0, 1.0).acos() * rate_hz / TAU;
            Point {
                time_s: middle as f64 / rate_hz,
                amplitude_m_s2: SQRT_2 * (power / window.len() as f64).sqrt(),
                // Silence has no frequency (NaN), which `max` replaces by the lowest frequency.
                frequency_hz: mean_hz.max(RANGE_HZ.0).min(RANGE_HZ.1),
            }
        };
        Self((0..=samples.len().div_ceil(step)).map(point).collect())
    }

    pub fn amplitudes_m_s2(&self) -> impl Iterator<Item = f64> {
        self.0.iter().map(|point| point.amplitude_m_s2)
    }

    /// Returns the samples of the tone, m/s².
    pub fn tone(&self, rate_hz: f64) -> Vec<f64> {
        // The phase is carried on from point to point, so that the tone does not jump.
        let (mut tone, mut phase) = (Vec::new(), 0.0f64);
        for [from, to] in self.0.array_windows() {
            let begin = tone.len();
            let end = (to.time_s * rate_hz).round() as usize;
            for n in begin..end {
                let share = (n - begin) as f64 / (end - begin) as f64;
                let between = |from: f64, to: f64| from + share * (to - from);
                tone.push(between(from.amplitude_m_s2, to.amplitude_m_s2) * phase.sin());
                phase += TAU * between(from.frequency_hz, to.frequency_hz) / rate_hz;
            }
        }
        tone
    }

    /// Returns the `.haptic` file, version 1.0.0.
    pub fn haptic(&self, full_scale_m_s2: f64, description: &str) -> Value {
        let amplitude = self
            .0
            .iter()
            .map(|point| json!({"time": point.time_s, "amplitude": point.amplitude_m_s2 / full_scale_m_s2}));
        let frequency = (self.0.iter()).map(|point| json!({"time": point.time_s, "frequency": point.place()}));
        json!({
            "version": {"major": 1, "minor": 0, "patch": 0},
            "metadata": {"editor": "stylus", "description": description},
            "signals": {"continuous": {"envelopes": {
                "amplitude": amplitude.collect::<Vec<_>>(), "frequency": frequency.collect::<Vec<_>>(),
            }}},
        })
    }

    /// Returns the AHAP file: continuous events of full intensity and zero sharpness, and curves that control both.
    pub fn ahap(&self, full_scale_m_s2: f64, description: &str) -> Value {
        let end_s = self.0.last().map_or(0.0, |point| point.time_s);
        // A device multiplies an event's intensity by its curve, and adds the other curve to its sharpness.
        let events = (0..(end_s / MAX_EVENT_S).ceil() as u32).map(|index| {
            let begin_s = f64::from(index) * MAX_EVENT_S;
            json!({"Event": {
                "Time": begin_s, "EventType": "HapticContinuous", "EventDuration": MAX_EVENT_S.min(end_s - begin_s),
                "EventParameters": [
                    {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                    {"ParameterID": "HapticSharpness", "ParameterValue": 0.0},
                ],
            }})
        });
        let intensity = |point: &Point| point.amplitude_m_s2 / full_scale_m_s2;
        let pattern = events
            .chain(self.curves("HapticIntensityControl", intensity))
            .chain(self.curves("HapticSharpnessControl", Point::place));
        json!({
            "Version": 1.0, "Metadata": {"Project": "stylus", "Description": description},
            "Pattern": pattern.collect::<Vec<_>>(),
        })
    }

    /// Returns curves of a parameter through all points, with times relative to the beginning of each curve.
    fn curves(&self, name: &str, value: impl Fn(&Point) -> f64) -> impl Iterator<Item = Value> {
        // The last point begins no curve, because a curve needs two.
        (0..self.0.len().saturating_sub(1)).step_by(SEGMENTS).map(move |first| {
            let points = &self.0[first..self.0.len().min(first + SEGMENTS + 1)];
            let begin_s = points[0].time_s;
            let control = |point: &Point| json!({"Time": point.time_s - begin_s, "ParameterValue": value(point)});
            json!({"ParameterCurve": {
                "ParameterID": name, "Time": begin_s,
                "ParameterCurveControlPoints": points.iter().map(control).collect::<Vec<_>>(),
            }})
        })
    }
}

impl Point {
    /// Position of the frequency within [`RANGE_HZ`], 0 to 1.
    fn place(&self) -> f64 {
        (self.frequency_hz - RANGE_HZ.0) / (RANGE_HZ.1 - RANGE_HZ.0)
    }
}
