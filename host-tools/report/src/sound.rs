//! Signals as sounds that a browser plays.

use crate::recording::resample;
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

/// Sample rate of a page's sounds, Hz: every browser plays it.
const SOUND_RATE_HZ: u32 = 20_000;

/// Longest sound of a report, s: 120 KB.
const SOUND_S: f64 = 3.0;

/// Most that all sounds of a report take as WAV files; in the page they take a third more.
pub(super) const SOUNDS_BYTES: usize = 24_000_000;

/// Most that the sounds of all nodes of a report take, of [`SOUNDS_BYTES`]: five megabytes.
const NODES_BYTES: usize = 5_000_000;

/// Shortest and longest duration of a node's recording and of its synthesis, s.
const NODE_S: [f64; 2] = [0.2, 1.0];

/// The duration of what the page keeps of each of so many recordings, and of its synthesis, s; none of too many.
pub fn node_seconds(trials: usize) -> Option<f64> {
    let bytes_per_s = 2 * 2 * SAMPLE_RATE_HZ as usize;
    let seconds = NODES_BYTES as f64 / (bytes_per_s * trials.max(1)) as f64;
    (seconds >= NODE_S[0]).then_some(seconds.min(NODE_S[1]))
}

/// A clip of a node in 16 bits.
pub(super) fn clip(signal: &[f32], full_scale: f64) -> Vec<i16> {
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    let sample = |value: &f32| (f64::from(*value) * scale).round() as i16;
    signal.iter().map(sample).collect()
}

/// The beginning of a signal as the bytes of a WAV file; see [`whole_sound`].
pub(super) fn sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let most = ((SOUND_S * f64::from(SAMPLE_RATE_HZ)) as usize).min(signal.len());
    whole_sound(&signal[..most], full_scale)
}

/// A signal as the bytes of a WAV file, 16 bits, at a rate that every browser plays.
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
    // A tenth is left, because between its samples a signal goes beyond them, and at a higher rate that is there.
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    for sample in &there[0] {
        let sample = (sample * scale).clamp(f64::from(i16::MIN), f64::from(i16::MAX));
        writer.write_sample(sample as i16).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    Ok(bytes.into_inner())
}
