//! Strokes as files for other devices, read by readers of these tests' own, against what `stylus render` plays.

use std::f64::consts::TAU;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use host_tools::dsp::spectrum::{BAND_LABELS_HZ, band_powers};
use model_format::{CodeSpec, NodeFlags, NodeSpec, Provenance, TextureSpec, encode};
use serde_json::Value;

use crate::support::{Bench, decibels, holds, json, near, text};

/// Synthesis filters from their centres, of means and of details: the table of Antonini and others (IEEE Trans. Image
/// Process. 1, 1992, 205), with a gain of √2.
const FILTERS: [[f64; 5]; 2] = [
    [0.788_486, 0.418_092, -0.040_689, -0.064_539, 0.0],
    [-0.852_699, 0.377_403, 0.110_624, -0.023_849, -0.037_828],
];

/// A wavelet stream: bits after the interval and the value within it, and the zeros and symbols of each context.
struct Stream {
    bits: std::vec::IntoIter<u32>,
    interval: [u32; 3],
    seen: [(f64, f64); 7],
}

impl Stream {
    fn of(text: &str) -> Self {
        let bytes = STANDARD_NO_PAD.decode(text).expect("base64 unpadded");
        let bits_of =
            |byte: &u8| std::array::from_fn::<_, 8, _>(|n| u32::from(byte >> (7 - n) & 1));
        let mut bits = bytes
            .iter()
            .flat_map(bits_of)
            .collect::<Vec<_>>()
            .into_iter();
        let value = (0..10).fold(0, |value, _| 2 * value + bits.next().unwrap_or(0));
        let (interval, seen) = ([0, 1024, value], [(8.0, 16.0); 7]);
        Self {
            bits,
            interval,
            seen,
        }
    }

    fn bit(&mut self, context: usize) -> bool {
        let (zeros, all) = &mut self.seen[context];
        let range = f64::from(self.interval[1] - self.interval[0]);
        let split = (range * (1024.0 * *zeros / *all).round() / 1024.0).floor();
        let split = self.interval[0] + split.clamp(1.0, range - 1.0) as u32;
        let bit = self.interval[2] >= split;
        self.interval[usize::from(!bit)] = split;
        *zeros += f64::from(u8::from(!bit));
        *all += 1.0;
        loop {
            let below = match self.interval {
                [_, ..=512, _] => 0,
                [(512..), ..] => 512,
                [(256..), ..=768, _] => 256,
                _ => return bit,
            };
            self.interval = self.interval.map(|edge| 2 * (edge - below));
            self.interval[2] += self.bits.next().unwrap_or(0);
        }
    }

    /// Coefficients of a block, by Said and Pearlman's passes over single coefficients, trees and large coefficients.
    fn coefficients(&mut self, count: usize) -> Vec<f64> {
        let mut number = |bits| {
            (0..bits)
                .map(|bit| i32::from(self.bit(0)) << bit)
                .sum::<i32>()
        };
        let (highest, is_coarse, scale) = (number(4), number(1) == 1, f64::from(number(7)));
        let scale = if is_coarse {
            1.0 + scale / 8.0
        } else {
            scale / 128.0
        };
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

/// The samples of an MPEG haptics file, by the standard's equations.
fn of_mpeg(file: &Value) -> Vec<f64> {
    let channel = &file["perceptions"][0]["channels"][0];
    let band = &channel["bands"][0];
    let number = |of: &Value, key: &str| of[key].as_u64().expect("a number") as usize;
    let (milliseconds, rate_hz) = (
        number(band, "block_length"),
        number(band, "upper_frequency_limit"),
    );
    assert!(band["band_type"] == "WaveletWave" && milliseconds.is_power_of_two());
    let count = milliseconds * rate_hz / number(file, "timescale");
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

/// Points of a parameter of an AHAP file, whose curves join, and whose events are as long together.
fn of_ahap(file: &Value, parameter: &str) -> Vec<(f64, f64)> {
    let (mut all, mut end) = (Vec::new(), 0.0);
    for part in file["Pattern"].as_array().expect("a list") {
        let (event, curve) = (&part["Event"], &part["ParameterCurve"]);
        if event.is_object() {
            assert_eq!(event["Time"], end);
            end += event["EventDuration"]
                .as_f64()
                .filter(|&duration| duration <= 30.0)
                .expect("short");
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

/// A folder with a recorded texture at 5 kHz, a simulated one at 10 kHz, and a motion with a rest.
fn bench() -> Bench {
    let texture = |name, sample_rate_hz, provenance| {
        let node = |output_power: f32, codes: [i16; 2]| NodeSpec {
            output_power,
            prediction_error_power: output_power / 2.0,
            flags: NodeFlags::NONE,
            codes: CodeSpec::lattice(codes.to_vec()),
        };
        let nodes = vec![node(1.0, [-22_000, 15_000]), node(9.0, [-25_000, 9000])];
        let spec = TextureSpec::new(name, &[50.0, 150.0], &[0.5], nodes);
        TextureSpec {
            sample_rate_hz,
            provenance,
            ..spec
        }
    };
    let bench = Bench::new();
    let felt = texture("felt", 5000, Provenance::Recorded);
    let library = encode(&[felt, texture("silk", 10_000, Provenance::Simulated)]);
    bench.write("a.lib", library.unwrap());
    let rows = "0,0,0\n0.1,80,0.8\n0.8,150,1\n0.9,0,0\n1.3,0,0\n1.4,60,0.6\n40,120,0.9\n";
    bench.write("m.csv", format!("time_s,speed_mm_s,force_n\n{rows}"));
    bench
}

/// What `stylus render` plays, m/s², with its rate.
fn rendered(bench: &Bench, texture: &str) -> (Vec<f64>, f64) {
    bench.succeed(&format!(
        "render a.lib --texture {texture} --motion m.csv --out r.wav"
    ));
    let reader = hound::WavReader::open(bench.path("r.wav")).unwrap();
    let rate_hz = f64::from(reader.spec().sample_rate);
    let samples = reader.into_samples::<f32>();
    (
        samples.map(|sample| f64::from(sample.unwrap())).collect(),
        rate_hz,
    )
}

/// The file in `format`, its full scale, and what was warned of.
fn exported(bench: &Bench, texture: &str, format: &str) -> (Value, f64, String) {
    let words =
        format!("export a.lib --texture {texture} --motion m.csv --format {format} --out f");
    let output = bench.run(&words);
    assert!(output.status.success());
    let said = text(&output.stdout);
    let description = said.trim_end().split_once(": ").unwrap().1;
    holds(
        description,
        &[
            texture,
            if texture == "silk" {
                "(SIMULATED)"
            } else {
                "(recorded)"
            },
        ],
    );
    let file = std::fs::read_to_string(bench.path("f")).unwrap();
    holds(&file, &[description]);
    let scale = description
        .split("1.0 is ")
        .nth(1)
        .unwrap()
        .split(' ')
        .next()
        .unwrap();
    (json(&file), scale.parse().unwrap(), text(&output.stderr))
}

#[test]
fn a_decoder_of_mpeg_haptics_has_the_third_octaves_and_the_samples_that_the_stylus_plays() {
    let bench = bench();
    for texture in ["felt", "silk"] {
        let (played, rate_hz) = rendered(&bench, texture);
        let (file, scale, warned) = exported(&bench, texture, "hjif");
        assert_eq!(
            warned.contains("nothing above 4000 Hz: -"),
            texture == "silk"
        );
        let decoded: Vec<f64> = of_mpeg(&file).iter().map(|value| scale * value).collect();
        let (expected, found) = (band_powers(&played, rate_hz), band_powers(&decoded, 8000.0));
        for (band, label) in BAND_LABELS_HZ.iter().enumerate().skip(2) {
            let error = decibels(found[band] / expected[band]);
            assert!(error.abs() < 0.05, "{texture}, {label} Hz: {error} dB");
        }
        // Both have a sample every millisecond. What is close to half the lower rate is lost.
        let pairs = played
            .iter()
            .step_by(rate_hz as usize / 1000)
            .zip(decoded.iter().step_by(8));
        let squares =
            |(played, decoded): (&f64, &f64)| [(played - decoded).powi(2), played * played];
        let [error, power] = pairs
            .map(squares)
            .fold([0.0, 0.0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        assert!(error < 0.03 * power, "{texture}: {error} of {power}");
        holds(&file.to_string(), &["\"wavelet_stream\":\"\""]);
    }
}

#[test]
fn a_tone_has_the_strokes_power_and_the_octaves_that_were_said_before() {
    let bench = bench();
    for (texture, format) in [("felt", "haptic"), ("silk", "ahap")] {
        let (played, rate_hz) = rendered(&bench, texture);
        let (file, scale, warned) = exported(&bench, texture, format);
        let envelopes = &file["signals"]["continuous"]["envelopes"];
        let curve = |of_haptic: &str, parameter| match format {
            "ahap" => of_ahap(&file, parameter),
            _ => points(&envelopes[of_haptic], &Value::Null, "time", of_haptic),
        };
        let amplitudes = curve("amplitude", "HapticIntensityControl");
        let frequencies = curve("frequency", "HapticSharpnessControl");
        for points in [&amplitudes, &frequencies] {
            assert!(points.is_sorted_by(|one, next| one.0 < next.0));
            assert!(points.iter().all(|(_, value)| (0.0..=1.0).contains(value)));
        }
        let mut turns = 0.0;
        let sample = |n: usize| {
            let time = n as f64 / rate_hz;
            let value = scale * at(&amplitudes, time) * f64::sin(TAU * turns);
            turns += (65.0 + 235.0 * at(&frequencies, time)) / rate_hz;
            value
        };
        let tone: Vec<f64> = (0..played.len()).map(sample).collect();
        let power = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>();
        near(decibels(power(&tone) / power(&played)), 0.0, 0.3);
        let (tone, stroke) = (band_powers(&tone, rate_hz), band_powers(&played, rate_hz));
        for (octave, label) in ["31.5", "63", "125", "250", "500"].iter().enumerate() {
            let power = |bands: &[f64]| bands[3 * octave + 1..][..3].iter().sum::<f64>();
            let said = warned.split(&format!(" {label} Hz ")).nth(1).expect("said");
            let said = said.split(' ').next().unwrap().parse().unwrap();
            near(said, decibels(power(&tone) / power(&stroke)), 0.2);
        }
    }
}

#[test]
fn a_wav_file_is_that_of_render_and_what_cannot_be_exported_is_refused() {
    let bench = bench();
    rendered(&bench, "felt");
    bench.succeed("export a.lib --texture felt --motion m.csv --format wav --out w.wav");
    let read = |name| std::fs::read(bench.path(name)).unwrap();
    assert_eq!(read("w.wav"), read("r.wav"));
    for (rest, words) in [
        (
            "--speed 80 --force 1 --seconds 601",
            ["600 s", "stylus render"],
        ),
        (
            "--speed 80 --force 1 --seconds 1 --full-scale 0.01",
            ["than 0.01", "--full-scale"],
        ),
        ("--speed 80 --force 0 --seconds 1", ["silent", "above zero"]),
    ] {
        let words_of = format!("export a.lib --texture felt {rest} --format hjif --out none");
        let output = bench.run(&words_of);
        assert_eq!(output.status.code(), Some(2));
        holds(&text(&output.stderr), &words);
        assert!(!bench.path("none").exists());
    }
}
