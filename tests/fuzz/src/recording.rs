//! Recordings as WAV and as CSV.

use host_tools::recording::{self, MAX_CHANNELS, MAX_FRAMES, Samples, Trial};
use host_tools::support::error::Error;
use model_format::SAMPLE_RATE_HZ;

use crate::place;

/// Judges `input`: WAV if it begins as one, and CSV otherwise, whose first byte says whether a rate is given.
pub fn judge(input: &[u8]) {
    if input.starts_with(b"RIFF") {
        judge_as("recording.wav", input, None);
    } else if let Some((first, table)) = input.split_first() {
        let rate_hz = (first % 2 == 0).then_some(f64::from(SAMPLE_RATE_HZ));
        judge_as("recording.csv", table, rate_hz);
    }
}

fn judge_as(name: &str, content: &[u8], sample_rate_hz: Option<f64>) {
    let path = place::written(name, content);
    let trial = |file| Trial {
        sample_rate_hz,
        ..Trial::of(file, "fuzz".to_owned(), 100.0, 1.0)
    };
    recording::holds_integers(&path);
    let samples = match recording::read(&trial(path.clone())) {
        Ok(samples) => samples,
        // The conversion of rates names a failure of its own.
        Err(error @ (Error::File { .. } | Error::Line { .. } | Error::Io { .. })) => {
            return place::check(&error, &path, content);
        }
        Err(error) => panic!("names no file: {error}"),
    };
    check(&samples);
    if samples.source_rate_hz == f64::from(SAMPLE_RATE_HZ) {
        let again = place::written("again.wav", &wav(&samples.axes));
        let again = recording::read(&trial(again)).expect("it was written from a recording");
        assert_eq!(again.axes, samples.axes);
    }
}

fn check(samples: &Samples) {
    let frames = samples.axes.first().map_or(0, Vec::len);
    assert!((1..=MAX_CHANNELS).contains(&samples.axes.len()));
    assert!((1..=MAX_FRAMES).contains(&frames));
    for axis in &samples.axes {
        assert_eq!(axis.len(), frames);
    }
    recording::triage::samples(samples);
}

/// A WAV file of double precision at the models' rate.
fn wav(axes: &[Vec<f64>]) -> Vec<u8> {
    const BYTES: usize = 8;
    let (channels, frames) = (axes.len(), axes[0].len());
    let length = frames * channels * BYTES;
    let mut bytes = b"RIFF".to_vec();
    bytes.extend((36 + length as u32).to_le_bytes());
    bytes.extend(b"WAVEfmt \x10\0\0\0\x03\0");
    bytes.extend((channels as u16).to_le_bytes());
    bytes.extend(SAMPLE_RATE_HZ.to_le_bytes());
    bytes.extend((SAMPLE_RATE_HZ * (channels * BYTES) as u32).to_le_bytes());
    bytes.extend(((channels * BYTES) as u16).to_le_bytes());
    bytes.extend((8 * BYTES as u16).to_le_bytes());
    bytes.extend(b"data");
    bytes.extend((length as u32).to_le_bytes());
    for frame in 0..frames {
        axes.iter()
            .for_each(|axis| bytes.extend(axis[frame].to_le_bytes()));
    }
    bytes
}
