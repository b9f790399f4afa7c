//! The sensors, from a recording at rest and from one that is moved.

use std::f64::consts::TAU;

use model_format::link::{RAIL_CODES, RecordSample};

use crate::link::capture::{Calibration, Capture};
use crate::procedures::self_test::line::Line;

/// Distance from an end of the range, in codes, within which a code counts as at the end. For an axis, which rests in
/// the middle, it is 1 % of the range. For the force, whose zero may lie low, it is the device's own limit.
const RAILS: [f64; 2] = [655.0, RAIL_CODES as f64];

/// Highest code of a converter.
const HIGHEST: f64 = 65_535.0;

/// Least noise of a working converter, codes RMS. A converter whose code never changes is stuck.
const LEAST_NOISE_CODES: f64 = 0.1;

/// Largest noise at rest: m/s² RMS of an axis, N RMS of the force.
const NOISE: [f64; 2] = [1.0, 0.05];

/// Largest hum at rest, of mains of 50 Hz or of 60 Hz, in the units of [`NOISE`].
const HUM: [f64; 2] = [0.2, 0.02];

/// Number of harmonics of a hum, its fundamental among them.
const HARMONICS: u32 = 5;

/// Largest number of encoder counts in a recording at rest. A few are allowed, because a track of the encoder may stand
/// on an edge.
const REST_COUNTS: u64 = 4;

/// Least number of counts of the encoder of a tool that was moved.
const MOVED_COUNTS: f64 = 100.0;

/// Amplitude RMS at `hz` of `signal`, taken at `rate_hz`, over whole periods.
fn tone(signal: &[f64], hz: f64, rate_hz: f64) -> f64 {
    let (mut real, mut imaginary) = (0.0, 0.0);
    for (n, x) in signal.iter().enumerate() {
        let (sine, cosine) = (TAU * hz * n as f64 / rate_hz).sin_cos();
        real += x * cosine;
        imaginary += x * sine;
    }
    f64::hypot(real, imaginary) * f64::sqrt(2.0) / signal.len() as f64
}

/// RMS of the harmonics of a mains of `hz`.
fn hum(signal: &[f64], hz: f64, rate_hz: f64) -> f64 {
    (1..=HARMONICS)
        .map(|n| tone(signal, f64::from(n) * hz, rate_hz).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Judges one sensor by its codes. The last argument has their scale, its unit, and the index of the sensor's limits.
fn sensor(name: &str, codes: &[f64], rate_hz: f64, (scale, unit, kind): (f64, &str, usize)) -> Vec<Line> {
    let count = codes.len() as f64;
    let mean = codes.iter().sum::<f64>() / count;
    // Whole tenths of a second are whole periods of 50 and 60 Hz.
    let whole = codes.len() - codes.len() % (rate_hz as usize / 10).max(1);
    let centred: Vec<f64> = codes.iter().map(|code| code - mean).collect();
    let rms = (centred.iter().map(|x| x * x).sum::<f64>() / count).sqrt();
    let (lowest, highest) = (codes.iter()).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
        (low.min(x), high.max(x))
    });
    let rail = lowest.min(HIGHEST - highest);
    let physical = rms * scale.abs();
    let mut lines = vec![
        Line::number(
            format!("{name} from the rails"),
            rail,
            (RAILS[kind], f64::INFINITY),
            ("codes", 0),
            "the sensor is at the end of its range: check its supply, its ground and its wire",
        ),
        Line::number(
            format!("{name} converts"),
            rms,
            (LEAST_NOISE_CODES, f64::INFINITY),
            ("codes RMS", 2),
            "the code never changes: the converter is stuck; restart the device and test again",
        ),
        Line::number(
            format!("{name} noise"),
            physical,
            (f64::NEG_INFINITY, NOISE[kind]),
            (unit, 3),
            "put the tool down on something soft and test again; if it stays, check the sensor's ground and shield",
        ),
    ];
    for mains in [50.0, 60.0] {
        lines.push(Line::number(
            format!("{name} hum of {mains} Hz"),
            hum(&centred[..whole], mains, rate_hz) * scale.abs(),
            (f64::NEG_INFINITY, HUM[kind]),
            (unit, 3),
            "mains reaches the sensor's wire: shorten and shield it, and use one ground",
        ));
    }
    lines
}

/// Judges a recording at rest, with the calibration of the device's settings.
pub fn at_rest(capture: &Capture, calibration: &Calibration) -> Vec<Line> {
    let rate_hz = f64::from(capture.rate_hz);
    let codes = |of: &dyn Fn(&RecordSample) -> u16| -> Vec<f64> {
        capture.samples.iter().map(|sample| f64::from(of(sample))).collect()
    };
    let mut lines = Vec::new();
    for (axis, name) in ["acceleration X", "acceleration Y", "acceleration Z"]
        .into_iter()
        .enumerate()
    {
        let codes = codes(&|sample| sample.acceleration[axis].0);
        let scale = (calibration.m_s2_per_code[axis], "m/s² RMS", 0);
        lines.extend(sensor(name, &codes, rate_hz, scale));
    }
    let force = codes(&|sample| sample.force.0);
    let scale = (calibration.n_per_code, "N RMS", 1);
    lines.extend(sensor("force", &force, rate_hz, scale));
    let counts = (capture.samples.iter())
        .map(|sample| u64::from(sample.encoder_delta.unsigned_abs()))
        .sum::<u64>();
    lines.push(Line::number(
        "encoder counts at rest",
        counts as f64,
        (0.0, REST_COUNTS as f64),
        ("", 0),
        "leave the tool alone and test again; if it stays, a line of the encoder picks up disturbances: shorten it",
    ));
    lines
}

/// Judges the encoder by a recording during which the tool was moved in one direction, and by the levels that were seen
/// on its lines.
pub fn moved(capture: &Capture, seen: [[bool; 2]; 2]) -> Vec<Line> {
    let deltas = || capture.samples.iter().map(|sample| i64::from(sample.encoder_delta));
    let path: i64 = deltas().map(i64::abs).sum();
    let net = deltas().sum::<i64>().abs();
    let mut lines = vec![
        Line::number(
            "encoder counts moved",
            path as f64,
            (MOVED_COUNTS, f64::INFINITY),
            ("", 0),
            "move the tool by a hand's breadth; if it was moved, check the encoder's supply and both its lines",
        ),
        Line::number(
            "encoder direction",
            net as f64 / (path.max(1)) as f64,
            (0.5, 1.0),
            ("", 2),
            "move the tool in one direction; if it was, one line is stuck, so the count goes up and down: check it",
        ),
    ];
    for (line, [low, high]) in ["A", "B"].into_iter().zip(seen) {
        let value = match (low, high) {
            (true, true) => "low and high",
            (false, true) => "high only",
            (true, false) => "low only",
            (false, false) => "not read",
        };
        lines.push(Line::exact(
            format!("encoder line {line}"),
            value,
            "low and high",
            "the line is stuck: check its wire and the encoder's supply",
        ));
    }
    lines
}
