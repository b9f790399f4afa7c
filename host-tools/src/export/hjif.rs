//! MPEG haptics (ISO/IEC 23090-31) as JSON: one channel with one wavelet band.

use std::time::SystemTime;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use serde_json::{Value, json};

use super::arithmetic_coder::Coder;
use super::set_partitioning::{HEAD, code};
use super::stroke::Stroke;
use super::wavelet::transform;
use crate::recording::resample;
use crate::support::error::{Error, Result};
use crate::support::{date, progress};

/// Rate of the band, Hz. Samples and milliseconds of a block must both be powers of two, which 5 and 10 kHz do not
/// allow.
pub const RATE_HZ: u32 = 8000;

/// Samples of a block. Seven levels of means then stay below the largest scale of a stream, 16.875.
const BLOCK: usize = 512;

/// Milliseconds of a block.
const BLOCK_MS: usize = BLOCK * 1000 / RATE_HZ as usize;

/// Highest bit of a coefficient that is as large as the scale of its block: the most that a stream's head can name.
const HIGHEST_BIT: u32 = 15;

/// Returns the stroke at [`RATE_HZ`].
///
/// # Errors
/// A sample rate that cannot be converted.
pub fn resampled(stroke: &Stroke) -> Result<Vec<f64>> {
    let from_hz = stroke.rendered().sample_rate_hz;
    let resampled = resample(&[stroke.accelerations()], from_hz, RATE_HZ);
    let failed = |problem| Error::Request(format!("{from_hz} Hz to {RATE_HZ} Hz: {problem}"));
    Ok(resampled.map_err(failed)?.remove(0))
}

/// Returns the file of `samples` in m/s², with a progress bar.
pub fn file(samples: &[f64], full_scale_m_s2: f64, description: &str) -> Value {
    let bar = progress::bar(samples.len().div_ceil(BLOCK) as u64, "encoding");
    let blocks = bar.wrap_iter(samples.chunks(BLOCK)).enumerate();
    let effects = blocks.map(|(index, block)| {
        let mut scaled = [0.0; BLOCK];
        for (scaled, sample) in scaled.iter_mut().zip(block) {
            *scaled = sample / full_scale_m_s2;
        }
        json!({
            "effect_type": "Basis",
            "position": index * BLOCK_MS,
            "wavelet_stream": STANDARD_NO_PAD.encode(stream(&mut scaled)),
        })
    });
    let band = json!({
        "band_type": "WaveletWave",
        "block_length": BLOCK_MS,
        "lower_frequency_limit": 0,
        // Readers take the limit of a wavelet band for its sample rate.
        "upper_frequency_limit": RATE_HZ,
        "effects": effects.collect::<Vec<_>>(),
    });
    bar.finish_and_clear();
    let channel = json!({
        "id": 0,
        "description": description,
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "frequency_sampling": RATE_HZ,
        "sample_count": samples.len(),
        "vertices": [],
        "bands": [band],
    });
    let perception = json!({
        "id": 0,
        "avatar_id": 0,
        "description": description,
        "perception_modality": "Vibrotactile",
        "reference_devices": [],
        "effect_library": [],
        "channels": [channel],
    });
    json!({
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": date::utc(SystemTime::now()),
        "description": description,
        "timescale": 1000,
        "avatars": [],
        "perceptions": [perception],
        "syncs": [],
    })
}

/// Returns the stream of a block within ±1, empty for silence.
fn stream(block: &mut [f64; BLOCK]) -> Vec<u8> {
    transform(block);
    let (scale_code, scale) = scale_of(super::largest(block.iter().copied()));
    let steps = f64::from(1 << HIGHEST_BIT) / scale;
    let coefficients = block.map(|coefficient| (coefficient * steps).round() as i32);
    if coefficients.iter().all(|&coefficient| coefficient == 0) {
        return Vec::new();
    }
    let mut coder = Coder::new();
    let head = HIGHEST_BIT | scale_code << 4;
    for bit in 0..12 {
        coder.push(HEAD, head >> bit & 1 == 1);
    }
    code(&coefficients, HIGHEST_BIT, |context, bit| {
        coder.push(context, bit);
    });
    coder.finish()
}

/// Returns the smallest scale that is at least `largest`, with its code: below 1 in steps of 1/128, from there in steps
/// of 1/8.
fn scale_of(largest: f64) -> (u32, f64) {
    let fine = (largest * 128.0).ceil().max(1.0);
    if fine < 128.0 {
        return ((fine as u32) << 1, fine / 128.0);
    }
    let coarse = ((largest - 1.0) * 8.0).ceil().clamp(0.0, 127.0);
    (1 | (coarse as u32) << 1, 1.0 + coarse / 8.0)
}
