//! Conversion of signals to sounds that a browser plays.

use model_format::SAMPLE_RATE_HZ;
use stylus_signals::recording::resample;
use stylus_support::{Error, Result};

/// Sample rate of a page's sounds, Hz. Every browser plays it.
const SOUND_RATE_HZ: u32 = 20_000;

/// Longest sound of a report, s. As a WAV file it has 120 KB.
const SOUND_S: f64 = 3.0;

/// Largest size of all sounds of a report as WAV files, bytes. In the page they take a third more.
pub(super) const SOUNDS_BYTES: usize = 24_000_000;

/// Largest part of [`SOUNDS_BYTES`] that the sounds of all nodes of a report take, bytes.
const NODES_BYTES: usize = 5_000_000;

/// Shortest and longest duration of a node's recording and of its synthesis, s.
const NODE_S: [f64; 2] = [0.2, 1.0];

/// Returns how many seconds of each of `trials` recordings, and of its synthesis, the page keeps; `None` if there are
/// too many trials.
pub fn node_seconds(trials: usize) -> Option<f64> {
    // Two signals, and two bytes per sample.
    let bytes_per_s = 2 * 2 * SAMPLE_RATE_HZ as usize;
    let seconds = NODES_BYTES as f64 / (bytes_per_s * trials.max(1)) as f64;
    (seconds >= NODE_S[0]).then_some(seconds.min(NODE_S[1]))
}

/// Converts a node's signal to a clip of 16-bit samples.
pub(super) fn clip(signal: &[f32], full_scale: f64) -> Vec<i16> {
    // The scale of silence must be a number, too.
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    let sample = |value: &f32| (f64::from(*value) * scale).round() as i16;
    signal.iter().map(sample).collect()
}

/// Converts the first [`SOUND_S`] of a signal to the bytes of a WAV file; see [`whole_sound`].
pub(super) fn sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let most = ((SOUND_S * f64::from(SAMPLE_RATE_HZ)) as usize).min(signal.len());
    whole_sound(&signal[..most], full_scale)
}

/// Converts a signal to the bytes of a WAV file of 16 bits, at a rate that every browser plays.
pub(super) fn whole_sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let there = resample(&[signal.to_vec()], SAMPLE_RATE_HZ, SOUND_RATE_HZ);
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: SOUND_RATE_HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let failed = |failure: hound::Error| Error::Request(failure.to_string());
    let mut writer = hound::WavWriter::new(&mut bytes, spec).map_err(failed)?;
    // A tenth of the range is left free, because a signal may exceed its samples between them, and at the higher rate
    // there are samples there.
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    for sample in &there[0] {
        let sample = (sample * scale).clamp(f64::from(i16::MIN), f64::from(i16::MAX));
        writer.write_sample(sample as i16).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    Ok(bytes.into_inner())
}
