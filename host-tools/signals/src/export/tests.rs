//! Exported files, decoded by independent readers, compared with what the kernel plays.

use std::f64::consts::TAU;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use serde_json::Value;
use stylus_dsp::spectrum::{BAND_LABELS_HZ, band_powers};

use super::*;
use crate::playing::render::render;
use crate::playing::render::test_motions::{constant, sweep};
use test_helpers::{library, near, texture};

/// Synthesis filters, from their centres outwards, for the means and for the details: the table of Antonini and others
/// (IEEE Trans. Image Process. 1, 1992, 205), with a gain of √2.
const FILTERS: [[f64; 5]; 2] = [
    [0.788_486, 0.418_092, -0.040_689, -0.064_539, 0.0],
    [-0.852_699, 0.377_403, 0.110_624, -0.023_849, -0.037_828],
];

/// A wavelet stream; the interval, the value within it and the current bit; and the counts of zeros and symbols of each
/// context.
struct Stream(Vec<u8>, [u32; 3], usize, [(f64, f64); 7]);

impl Stream {
    fn of(text: &str) -> Self {
        let mut bytes = STANDARD_NO_PAD.decode(text).expect("base64 unpadded");
        bytes.resize(bytes.len() + 2, 0);
        let value = u32::from(bytes[0]) << 2 | u32::from(bytes[1]) >> 6;
        Self(bytes, [0, 1024, value], 10, [(8.0, 16.0); 7])
    }

    fn bit(&mut self, context: usize) -> bool {
        let (zeros, all) = &mut self.3[context];
        let range = f64::from(self.1[1] - self.1[0]);
        let split = (range * (1024.0 * *zeros / *all).round() / 1024.0).floor();
        let split = self.1[0] + split.clamp(1.0, range - 1.0) as u32;
        let bit = self.1[2] >= split;
        self.1[usize::from(!bit)] = split;
        *zeros += f64::from(u8::from(!bit));
        *all += 1.0;
        loop {
            let below = match self.1 {
                [_, ..=512, _] => 0,
                [(512..), ..] => 512,
                [(256..), ..=768, _] => 256,
                _ => return bit,
            };
            self.1 = self.1.map(|edge| 2 * (edge - below));
            let byte = self.0.get(self.2 / 8).copied().unwrap_or(0);
            self.1[2] += u32::from(byte >> (7 - self.2 % 8) & 1);
            self.2 += 1;
        }
    }

    /// Coefficients of a block, decoded with Said and Pearlman's passes over single coefficients, trees and large
    /// coefficients.
    fn coefficients(&mut self, count: usize) -> Vec<f64> {
        let head: i32 = (0..12).map(|bit| i32::from(self.bit(0)) << bit).sum();
        let (highest, scale) = (head & 15, f64::from(head >> 5));
        let coarse = 1.0 + scale / 8.0;
        let scale = [scale / 128.0, coarse][(head >> 4 & 1) as usize];
        let mut found = vec![0i32; count];
        let (mut single, mut large): (Vec<_>, Vec<_>) = ((0..8).collect(), Vec::new());
        let mut trees: Vec<_> = (4..8).map(|root| (root, 3)).collect();
        for step in (0..=highest).rev().map(|bit| 1 << bit) {
            let known = large.len();
            let mut is_small = |stream: &mut Self, i: usize, context| {
                let is_large = stream.bit(context);
                if is_large {
                    found[i] = if stream.bit(1) { step } else { -step };
                    large.push(i);
                }
                !is_large
            };
            single.retain(|&i| is_small(self, i, 2));
            let mut place = 0;
            while let Some(&(root, kind)) = trees.get(place) {
                let children = [2 * root, 2 * root + 1];
                if !self.bit(kind) {
                    place += 1;
                    continue;
                }
                trees.remove(place);
                if kind == 5 {
                    trees.extend(children.map(|child| (child, 3)));
                    continue;
                }
                single.extend(children.into_iter().filter(|&i| is_small(self, i, 4)));
                trees.extend((4 * root + 3 < count).then_some((root, 5)));
            }
            for &i in &large[..known] {
                found[i] += i32::from(self.bit(6)) * found[i].signum() * step;
            }
        }
        let unit = scale / f64::from(1 << highest);
        found.iter().map(|&steps| f64::from(steps) * unit).collect()
    }
}

/// The samples of an MPEG haptics file, computed with the standard's equations.
fn of_mpeg(file: &Value) -> Vec<f64> {
    let channel = &file["perceptions"][0]["channels"][0];
    let band = &channel["bands"][0];
    let number = |of: &Value, key: &str| of[key].as_u64().expect("a number") as usize;
    let milliseconds = number(band, "block_length");
    assert!(band["band_type"] == "WaveletWave" && milliseconds.is_power_of_two());
    let count = milliseconds * number(band, "upper_frequency_limit") / number(file, "timescale");
    let mut samples = Vec::new();
    for (index, effect) in band["effects"].as_array().unwrap().iter().enumerate() {
        assert_eq!(number(effect, "position"), index * milliseconds);
        let stream = effect["wavelet_stream"].as_str().unwrap();
        let mut block = Stream::of(stream).coefficients(count);
        for length in (3..=count.ilog2()).map(|level| 1 << level) {
            let sample = |n: isize| {
                let part = |k: isize| {
                    let i = (n + k).unsigned_abs();
                    let i = i.min((2 * length - 2usize).wrapping_sub(i));
                    FILTERS[i % 2][k.unsigned_abs()] * block[i / 2 + i % 2 * length / 2]
                };
                (-4..=4).map(part).sum::<f64>()
            };
            let joined: Vec<f64> = (0..length as isize).map(sample).collect();
            block[..length].copy_from_slice(&joined);
        }
        samples.extend(block);
    }
    samples.truncate(number(channel, "sample_count"));
    samples
}

/// Times and values of the points of a curve.
fn points(list: &Value, begin: &Value, time: &str, value: &str) -> Vec<(f64, f64)> {
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let point = |point: &Value| (number(begin) + number(&point[time]), number(&point[value]));
    list.as_array().expect("a list").iter().map(point).collect()
}

/// Points of a parameter of an AHAP file. The curves must join, and the events must last as long as the curves.
fn of_ahap(file: &Value, parameter: &str) -> Vec<(f64, f64)> {
    let (mut all, mut end) = (Vec::new(), 0.0);
    for part in file["Pattern"].as_array().expect("a list") {
        let (event, curve) = (&part["Event"], &part["ParameterCurve"]);
        if event.is_object() {
            let duration = event["EventDuration"].as_f64().expect("a number");
            assert!(event["Time"] == end && duration <= 30.0);
            end += duration;
        }
        if curve["ParameterID"] == parameter {
            let list = &curve["ParameterCurveControlPoints"];
            let points = points(list, &curve["Time"], "Time", "ParameterValue");
            assert!(points.len() <= 16 && all.pop().is_none_or(|last| last == points[0]));
            all.extend(points);
        }
    }
    near(all[all.len() - 1].0, end, 1e-9);
    all
}

/// The value of a curve at a time.
fn at(points: &[(f64, f64)], time: f64) -> f64 {
    let next = points
        .partition_point(|point| point.0 <= time)
        .clamp(1, points.len() - 1);
    let ((from, before), (to, after)) = (points[next - 1], points[next]);
    before + (after - before) * (time - from) / (to - from)
}

/// Samples that the kernel plays along `motion`, m/s², and the JSON file with a full scale of 40 m/s² and its warnings.
fn exported(rate_hz: u32, motion: &MotionPath, format: Format) -> (Vec<f64>, Value, String) {
    let library = library(rate_hz);
    let played = render(texture(&library), motion, 40.0, 7).unwrap();
    let export = Export::new(texture(&library), motion, (40.0, 7), format, Some(40.0)).unwrap();
    let file = String::from_utf8(export.bytes).unwrap();
    assert!(file.contains(&export.description) && file.contains("SIMULATED"));
    let file = serde_json::from_str(&file).unwrap();
    (played.accelerations_m_s2(), file, export.warnings.join(" "))
}

fn decibels(part: f64, whole: f64) -> f64 {
    10.0 * (part / whole).log10()
}

#[test]
fn a_decoder_of_mpeg_haptics_has_the_third_octaves_and_the_samples_that_the_stylus_plays() {
    for rate_hz in [5000, 10_000] {
        let (played, file, warned) = exported(rate_hz, &constant(80.0, 0.7), Format::Hjif);
        assert_eq!(warned.contains("nothing above 4000 Hz: -"), rate_hz == 10_000);
        let decoded: Vec<f64> = of_mpeg(&file).iter().map(|value| 40.0 * value).collect();
        let expected = band_powers(&played, f64::from(rate_hz));
        let found = band_powers(&decoded, 8000.0);
        for band in 2..BAND_LABELS_HZ.len() {
            near(decibels(found[band], expected[band]), 0.0, 0.05);
        }
        // Both have a sample every millisecond. Components near or above half the lower rate are lost.
        let played = played.iter().step_by(rate_hz as usize / 1000);
        let (error, power) = played
            .zip(decoded.iter().step_by(8))
            .fold((0.0, 0.0), |(error, power), (played, decoded)| {
                (error + (played - decoded).powi(2), power + played * played)
            });
        assert!(error < 0.5 * power, "{error} of {power}");
    }
}

#[test]
fn silence_takes_no_bits() {
    let (played, file, _) = exported(5000, &sweep(), Format::Hjif);
    assert!(file.to_string().contains("\"wavelet_stream\":\"\""));
    assert_eq!((played[100_000], of_mpeg(&file)[160_000]), (0.0, 0.0));
}

#[test]
fn a_tone_has_the_strokes_power_and_the_octaves_that_are_said_before() {
    for format in [Format::Haptic, Format::Ahap] {
        let (played, file, warned) = exported(5000, &constant(80.0, 0.7), format);
        let envelopes = &file["signals"]["continuous"]["envelopes"];
        let curve = |name: &str, parameter| match format {
            Format::Ahap => of_ahap(&file, parameter),
            _ => points(&envelopes[name], &Value::Null, "time", name),
        };
        let amplitudes = curve("amplitude", "HapticIntensityControl");
        let frequencies = curve("frequency", "HapticSharpnessControl");
        for points in [&amplitudes, &frequencies] {
            assert!(points.is_sorted_by(|one, next| one.0 < next.0));
            assert!(points.iter().all(|(_, value)| (0.0..=1.0).contains(value)));
        }
        let mut turns = 0.0;
        let sample = |n: usize| {
            let time = n as f64 / 5000.0;
            let value = 40.0 * at(&amplitudes, time) * f64::sin(TAU * turns);
            turns += (65.0 + 235.0 * at(&frequencies, time)) / 5000.0;
            value
        };
        let tone: Vec<f64> = (0..played.len()).map(sample).collect();
        let power = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>();
        near(decibels(power(&tone), power(&played)), 0.0, 0.3);
        let (tone, stroke) = (band_powers(&tone, 5000.0), band_powers(&played, 5000.0));
        for (octave, label) in ["31.5", "63", "125", "250", "500"].iter().enumerate() {
            let power = |bands: &[f64]| bands[3 * octave + 1..][..3].iter().sum::<f64>();
            let said = warned
                .split(&format!(" {label} Hz "))
                .nth(1)
                .unwrap()
                .split(' ')
                .next()
                .unwrap()
                .parse()
                .unwrap();
            near(said, decibels(power(&tone), power(&stroke)), 0.2);
        }
    }
}
