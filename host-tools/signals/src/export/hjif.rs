//! MPEG haptics (ISO/IEC 23090-31) as JSON: one channel with one wavelet band.

use std::time::SystemTime;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use serde_json::{Value, json};
use stylus_support::{date, progress};

use super::largest;
use super::wavelet_stream::{Coder, HEAD, partition, transform};

/// Rate of the band, Hz. The duration of a block in samples and in milliseconds must both be powers of two, which 5 and
/// 10 kHz do not allow.
pub const RATE_HZ: u32 = 8000;

/// Number of samples per block.
const BLOCK: usize = 512;

/// Duration of a block, ms.
const BLOCK_MS: usize = BLOCK * 1000 / RATE_HZ as usize;

/// Highest bit of a coefficient that equals its block's scale: the largest value that a stream's head can state.
const HIGHEST_BIT: u32 = 15;

/// Returns the file of samples within ±1 at [`RATE_HZ`], and shows a progress bar.
pub fn file(samples: &[f64], description: &str) -> Value {
    let bar = progress::bar(samples.len().div_ceil(BLOCK) as u64, "encoding");
    let effects = bar.wrap_iter(samples.chunks(BLOCK)).enumerate().map(|(index, block)| {
        // Zeros fill the last block; `sample_count` tells where the stroke ends.
        let block = std::array::from_fn(|n| block.get(n).copied().unwrap_or(0.0));
        let stream = STANDARD_NO_PAD.encode(stream(block));
        json!({"effect_type": "Basis", "position": index * BLOCK_MS, "wavelet_stream": stream})
    });
    // Readers use the upper limit of a wavelet band as its sample rate.
    let band = json!({
        "band_type": "WaveletWave", "block_length": BLOCK_MS, "lower_frequency_limit": 0,
        "upper_frequency_limit": RATE_HZ, "effects": effects.collect::<Vec<_>>(),
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
    transform(&mut block);
    let (scale_code, scale) = scale_of(largest(block.iter().copied()));
    let steps = f64::from(1 << HIGHEST_BIT) / scale;
    let coefficients = block.map(|coefficient| (coefficient * steps).round() as i32);
    if coefficients == [0; BLOCK] {
        return Vec::new();
    }
    let mut coder = Coder::default();
    let head = HIGHEST_BIT | scale_code << 4;
    // The head is 4 bits of the highest bit, one of the scale's kind and 7 of the scale, each with its lowest bit
    // first.
    (0..12).for_each(|bit| coder.push(HEAD, head >> bit & 1 == 1));
    partition(&coefficients, HIGHEST_BIT, |context, bit| {
        coder.push(context, bit);
    });
    coder.finish()
}

/// Returns the smallest scale that is at least `largest`, with its code. Below 1, scales have steps of 1/128; above,
/// steps of 1/8 up to 16.875.
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

    /// A coefficient is largest for the block that consists of the signs of its weights. The weights are found by
    /// transforming impulses.
    #[test]
    fn no_block_within_one_has_a_coefficient_above_the_largest_scale() {
        let mut most = [0.0; BLOCK];
        for place in 0..BLOCK {
            let mut impulse = std::array::from_fn::<_, BLOCK, _>(|n| f64::from(u8::from(n == place)));
            transform(&mut impulse);
            most = std::array::from_fn(|n| most[n] + impulse[n].abs());
        }
        let (code, scale) = scale_of(largest(most.into_iter()));
        assert!(code < 1 << 8, "{code} {scale}");
        assert!(scale >= largest(most.into_iter()), "{code} {scale}");
    }
}
