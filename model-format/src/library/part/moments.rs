//! Part of kind 8: codebooks in blocks that keep the level of their recordings. They are played in longer snippets,
//! called moments.
//!
//! The content is the mean length of a moment in samples, a varint. With this part, the codes of each codebook of the
//! excitation are blocks of [`BLOCK_BYTES`]: [`BLOCK_SAMPLES`] codes of 3 bits, the first in the lowest bits of the
//! first byte, and a byte with the block's level L, -128 to 0, in steps of 0.5 dB. A code stands for ± peak · 10^(L/40)
//! · m: bit 2 is set if the value is negative, and m = (5^((2k + 1)/7) - 1)/4, where k is the number in bits 0 and 1.

use super::modulation::level_amplitude;
use crate::error::Problem;
use crate::limits::{MAX_MOMENT_SAMPLES, MIN_MOMENT_SAMPLES};
use crate::wire::Reader;

#[cfg(feature = "alloc")]
use super::PartSpec;

/// Kind of this part.
pub(crate) const KIND: u32 = 8;

/// Samples of a block.
pub const BLOCK_SAMPLES: usize = 64;

/// Bytes of a block: the codes, then the level.
pub const BLOCK_BYTES: usize = 25;

/// Magnitudes of the codes as fractions of the block's level, in steps of 2⁻¹⁴: (5^((2k + 1)/7) - 1)/4 within a step.
/// The second would be rounded to 4068. These four numbers, not the formula, are the format.
pub const BLOCK_MAGNITUDES: [i32; 4] = [1059, 4069, 8835, 16_384];

/// Squares of [`BLOCK_MAGNITUDES`], in steps of 2⁻²⁸.
const SQUARES: [u32; 4] = [1059 * 1059, 4069 * 4069, 8835 * 8835, 1 << 28];

/// Returns a block's level as a fraction of the codebook's peak, in steps of 2⁻¹⁶. A level above 0, which no library
/// has, counts as 0.
#[inline]
pub fn block_scale(level: i8) -> u32 {
    // A step of `level` is 0.5 dB, twice a step of a level track. Therefore the track's amplitude is squared.
    let root = u64::from(level_amplitude(level.min(0)));
    ((root * root) >> 16) as u32
}

/// Value of sample `index` of a block as a fraction of the codebook's peak, in steps of 2⁻³⁰. `index` must be below
/// [`BLOCK_SAMPLES`].
#[inline]
pub fn block_share(block: &[u8; BLOCK_BYTES], index: usize) -> i32 {
    let bit = 3 * (index % BLOCK_SAMPLES);
    // The second byte always exists, because the byte of the level follows the codes.
    let bytes = [block[bit / 8], block[bit / 8 + 1]];
    let code = usize::from(u16::from_le_bytes(bytes) >> (bit % 8));
    let scale = block_scale(block[BLOCK_BYTES - 1].cast_signed()) as i32;
    let magnitude = scale * BLOCK_MAGNITUDES[code & 3];
    if code & 4 == 0 { magnitude } else { -magnitude }
}

/// Sum of the squares of a block's samples, each as a fraction of the peak, in steps of 2⁻³². `None` for a level above
/// 0.
#[inline]
pub(super) fn block_squares(block: &[u8; BLOCK_BYTES]) -> Option<u64> {
    let level = block[BLOCK_BYTES - 1].cast_signed();
    let mut sum = 0;
    // Eight codes of 3 bits are three bytes. The byte of the level is the remainder.
    for &[a, b, c] in block.as_chunks::<3>().0 {
        let mut codes = u32::from_le_bytes([a, b, c, 0]);
        for _ in 0..8 {
            sum += u64::from(SQUARES[codes as usize & 3]);
            codes >>= 3;
        }
    }
    let scale = u64::from(block_scale(level));
    // Shifted in two steps, because the whole product may have 66 digits.
    (level <= 0).then(|| (((scale * scale) >> 8) * sum) >> 20)
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MomentsPart<'a>(pub &'a [u8]);

impl MomentsPart<'_> {
    /// Mean length of a moment, samples.
    pub fn mean_samples(self) -> Result<u16, Problem> {
        let mut reader = Reader(self.0);
        let mean = reader.varint().filter(|_| reader.0.is_empty());
        let mean = mean.ok_or(Problem::Malformed("the length of its moments"))?;
        let means = [MIN_MOMENT_SAMPLES, MAX_MOMENT_SAMPLES].map(usize::from);
        Problem::count("the length of moments in samples", mean as usize, means)?;
        Ok(mean as u16)
    }
}

/// Creates the part for moments of this mean length.
#[cfg(feature = "alloc")]
pub(crate) fn part(mean_samples: u16) -> postcard::Result<PartSpec> {
    Ok((KIND, postcard::to_allocvec(&u32::from(mean_samples))?))
}
