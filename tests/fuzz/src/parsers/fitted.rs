//! Files that a fit reads: lists of trials, recordings as WAV and as CSV, and `HaTT`'s model files.

use std::fmt::Write;

use host_tools::fit::hatt::import::{Options, plan, read_all};
use host_tools::recording::{self, MAX_CHANNELS, RecordingSet, Samples, Snap, Trial, most_frames};
use host_tools::support::Error;
use host_tools::support::number::{MAX_FORCE_N, MAX_SPEED_MM_S};
use model_format::{Provenance, SAMPLE_RATE_HZ};

use super::{check, guarded, written};

/// Checks `input` as a list of trials.
pub fn list(input: &[u8]) {
    let path = written("trials.csv", input);
    let set = match RecordingSet::from_list(&path) {
        Ok(set) => set,
        Err(error) => return check(&error, &path, input),
    };
    for trial in &set.trials {
        assert!((0.0..=MAX_SPEED_MM_S).contains(&trial.speed_mm_s));
        assert!((0.0..=MAX_FORCE_N).contains(&trial.force_n));
        let scale = trial.scale_m_s2.unwrap_or(1.0);
        assert!(scale.is_finite() && scale != 0.0);
        assert!(!trial.texture.is_empty() && !trial.texture.contains(char::is_control));
    }
    let groups = set.by_texture();
    assert_eq!(
        groups.iter().map(|(_, members)| members.len()).sum::<usize>(),
        set.trials.len()
    );
    // The set is written as a list again, in two dialects. Each must be read as the same set.
    for (separator, decimal) in [(",", "."), (";", ",")] {
        let list = written("again.csv", rewritten(&set.trials, separator, decimal).as_bytes());
        let again = RecordingSet::from_list(&list).expect("it was written from a list");
        assert_eq!(again, set);
    }
    if let Ok((snapped, _)) = set.clone().snapped(Snap::Within(0.05)) {
        for (before, after) in set.trials.iter().zip(&snapped.trials) {
            let moved = (before.speed_mm_s - after.speed_mm_s).abs();
            assert!(moved <= 0.05 * before.speed_mm_s.max(after.speed_mm_s) * (1.0 + 1e-9));
        }
    }
}

fn rewritten(trials: &[Trial], separator: &str, decimal: &str) -> String {
    let names = [
        "file",
        "texture",
        "speed_mm_s",
        "force_n",
        "scale_m_s2",
        "start_s",
        "duration_s",
        "sample_rate_hz",
        "simulated",
    ];
    let mut text = names.join(separator) + "\n";
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:?}").replace('.', decimal));
    for trial in trials {
        let quoted = |text: &str| format!("\"{}\"", guarded(text).replace('"', "\"\""));
        let fields = [
            quoted(&trial.file.to_string_lossy()),
            quoted(&trial.texture),
            number(Some(trial.speed_mm_s)),
            number(Some(trial.force_n)),
            number(trial.scale_m_s2),
            number(Some(trial.start_s)),
            number(trial.duration_s),
            number(trial.sample_rate_hz),
            (trial.provenance == Provenance::Simulated).to_string(),
        ];
        writeln!(text, "{}", fields.join(separator)).expect("text grows");
    }
    text
}

/// Checks `input` as a recording: as WAV or of LabVIEW if it begins like one, otherwise as CSV after a first byte that
/// determines whether a rate is given.
pub fn recording(input: &[u8]) {
    if input.starts_with(b"LabVIEW Measurement") {
        read_as("recording.lvm", input, None);
    } else if input.starts_with(b"RIFF") {
        read_as("recording.wav", input, None);
    } else if let Some((first, table)) = input.split_first() {
        let rate_hz = (first % 2 == 0).then_some(f64::from(SAMPLE_RATE_HZ));
        read_as("recording.csv", table, rate_hz);
    }
}

fn read_as(name: &str, content: &[u8], sample_rate_hz: Option<f64>) {
    let path = written(name, content);
    let trial = |file| Trial {
        sample_rate_hz,
        ..Trial::of(file, "fuzz".to_owned(), 100.0, 1.0)
    };
    let samples = match recording::read(&trial(path.clone())) {
        Ok(samples) => samples,
        // Every refusal must name the file, including one by the conversion of rates.
        Err(error @ (Error::File { .. } | Error::Line { .. } | Error::Io { .. })) => {
            return check(&error, &path, content);
        }
        Err(error) => panic!("names no file: {error}"),
    };
    check_samples(&samples);
    // Only at the models' rate are the samples those of the file; other rates are converted.
    if samples.source_rate_hz == f64::from(SAMPLE_RATE_HZ) {
        let written = written("again.wav", &wav(&samples.axes));
        // What is large is held once at a time, because this is judged by its memory, too.
        drop(samples);
        let again = recording::read(&trial(written.clone())).expect("it was written from a recording");
        let bytes = std::fs::read(written).expect("it was written");
        assert!(wav(&again.axes) == bytes, "another recording than was written");
    }
}

fn check_samples(samples: &Samples) {
    let frames = samples.axes.first().map_or(0, Vec::len);
    assert!((1..=MAX_CHANNELS).contains(&samples.axes.len()));
    assert!((1..=most_frames(samples.axes.len())).contains(&frames));
    for axis in &samples.axes {
        assert_eq!(axis.len(), frames);
    }
    recording::triage::samples(samples, samples.slow_share());
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
        axes.iter().for_each(|axis| bytes.extend(axis[frame].to_le_bytes()));
    }
    bytes
}

/// Checks `input` as a model file.
pub fn hatt(input: &[u8]) {
    let path = written("Models_fuzz.xml", input);
    let options = Options {
        speeds: Some(2),
        forces: Some(2),
        ..Options::default()
    };
    let sources = match read_all(std::slice::from_ref(&path), &options) {
        Ok(sources) => sources,
        Err(error) => return check(&error, &path, input),
    };
    let toolkit = &sources[0].toolkit;
    assert!(!toolkit.models.is_empty());
    let mut corners = toolkit.triangles.iter().flatten();
    assert!(corners.all(|&corner| corner < toolkit.models.len()));
    for model in &toolkit.models {
        assert!(model.speed_mm_s.is_finite() && model.force_n.is_finite());
    }
    // A grid that does not fit a slot is refused for all files together.
    match plan(&sources, &options) {
        Ok(_) | Err(Error::Request(_)) => {}
        Err(error) => check(&error, &path, input),
    }
}
