//! MPEG haptics (ISO/IEC 23090-31) as JSON: one channel with one wavelet band.

use std::time::SystemTime;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use serde_json::{Value, json};

use super::arithmetic_coder::Coder;
use super::set_partitioning::{HEAD, code};
use super::{largest, wavelet};
use crate::recording::resample;
use crate::support::error::{Error, Result};
use crate::support::{date, progress};

/// Rate of the band, Hz. A block's samples and milliseconds must be powers of two, which 5 and 10 kHz do not allow.
pub const RATE_HZ: u32 = 8000;

/// Samples of a block.
const BLOCK: usize = 512;

/// Milliseconds of a block.
const BLOCK_MS: usize = BLOCK * 1000 / RATE_HZ as usize;

/// Highest bit of a coefficient as large as its block's scale: the most that a stream's head can name.
const HIGHEST_BIT: u32 = 15;

/// Returns samples at [`RATE_HZ`].
///
/// # Errors
/// A sample rate that cannot be converted.
pub fn resampled(samples: &[f64], from_hz: u32) -> Result<Vec<f64>> {
    let resampled = resample(&[samples.to_vec()], from_hz, RATE_HZ);
    let failed = |problem| Error::Request(format!("{from_hz} Hz to {RATE_HZ} Hz: {problem}"));
    Ok(resampled.map_err(failed)?.remove(0))
}

/// Returns the file of `samples` in m/s², with a progress bar.
pub fn file(samples: &[f64], full_scale_m_s2: f64, description: &str) -> Value {
    let bar = progress::bar(samples.len().div_ceil(BLOCK) as u64, "encoding");
    let blocks = bar.wrap_iter(samples.chunks(BLOCK)).enumerate();
    let effects = blocks.map(|(index, block)| {
        let scaled = |n| block.get(n).map_or(0.0, |sample| sample / full_scale_m_s2);
        let stream = STANDARD_NO_PAD.encode(stream(std::array::from_fn(scaled)));
        json!({"effect_type": "Basis", "position": index * BLOCK_MS, "wavelet_stream": stream})
    });
    let band = json!({
        "band_type": "WaveletWave", "block_length": BLOCK_MS, "lower_frequency_limit": 0,
        // Readers take this limit for the sample rate.
        "upper_frequency_limit": RATE_HZ,
        "effects": effects.collect::<Vec<_>>(),
    });
    bar.finish_and_clear();
    let channel = json!({
        "id": 0, "description": description, "gain": 1.0, "mixing_coefficient": 1.0, "body_part_mask": 0,
        "frequency_sampling": RATE_HZ, "sample_count": samples.len(), "vertices": [], "bands": [band],
    });
    let perception = json!({
        "id": 0, "avatar_id": 0, "description": description, "perception_modality": "Vibrotactile",
        "reference_devices": [], "effect_library": [], "channels": [channel],
    });
    json!({
        "version": "2023", "profile": "Main", "level": 1, "date": date::utc(SystemTime::now()),
        "description": description, "timescale": 1000, "avatars": [], "perceptions": [perception], "syncs": [],
    })
}

/// Returns the stream of a block within ±1, empty for silence.
fn stream(mut block: [f64; BLOCK]) -> Vec<u8> {
    wavelet::transform(&mut block);
    let (scale_code, scale) = scale_of(largest(&block));
    let steps = f64::from(1 << HIGHEST_BIT) / scale;
    let coefficients = block.map(|coefficient| (coefficient * steps).round() as i32);
    if coefficients == [0; BLOCK] {
        return Vec::new();
    }
    let mut coder = Coder::default();
    let head = HIGHEST_BIT | scale_code << 4;
    (0..12).for_each(|bit| coder.push(HEAD, head >> bit & 1 == 1));
    code(&coefficients, HIGHEST_BIT, |context, bit| {
        coder.push(context, bit);
    });
    coder.finish()
}

/// Returns the smallest scale that is at least `largest`, with its code: below 1 in steps of 1/128, from there in steps
/// of 1/8 up to 16.875.
fn scale_of(largest: f64) -> (u32, f64) {
    let fine = (largest * 128.0).ceil().max(1.0);
    if fine < 128.0 {
        return ((fine as u32) << 1, fine / 128.0);
    }
    let coarse = ((largest - 1.0) * 8.0).ceil().max(0.0);
    (1 | (coarse as u32) << 1, 1.0 + coarse / 8.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A coefficient is largest for the block of the signs of its weights. The weights are the transforms of impulses.
    #[test]
    fn no_block_within_one_has_a_coefficient_above_the_largest_scale() {
        let mut most = [0.0; BLOCK];
        for place in 0..BLOCK {
            let mut impulse = [0.0; BLOCK];
            impulse[place] = 1.0;
            wavelet::transform(&mut impulse);
            most.iter_mut()
                .zip(impulse)
                .for_each(|(sum, weight)| *sum += weight.abs());
        }
        let (code, scale) = scale_of(largest(&most));
        assert!(code < 1 << 8 && scale >= largest(&most), "{code} {scale}");
    }
}
