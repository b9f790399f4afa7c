//! Signals as sounds that a browser plays.

use crate::recording::resample;
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

/// Sample rate of a page's sounds, Hz: every browser plays it.
const SOUND_RATE_HZ: u32 = 20_000;

/// Longest sound of a report, s.
#[cfg(feature = "spectrograms")]
const SOUND_S: f64 = 3.0;

/// The beginning of a signal as the bytes of a WAV file; see [`whole_sound`].
#[cfg(feature = "spectrograms")]
pub(super) fn sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let most = ((SOUND_S * f64::from(SAMPLE_RATE_HZ)) as usize).min(signal.len());
    whole_sound(&signal[..most], full_scale)
}

/// A signal as the bytes of a WAV file, 16 bits, at a rate that every browser plays.
pub(super) fn whole_sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let there =
        resample(&[signal.to_vec()], SAMPLE_RATE_HZ, SOUND_RATE_HZ).map_err(Error::Request)?;
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: SOUND_RATE_HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let failed = |failure: hound::Error| Error::Request(failure.to_string());
    let mut writer = hound::WavWriter::new(&mut bytes, spec).map_err(failed)?;
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    for sample in &there[0] {
        let sample = (sample * scale).clamp(f64::from(i16::MIN), f64::from(i16::MAX));
        writer.write_sample(sample as i16).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    Ok(bytes.into_inner())
}
