//! Blocks of codes: samples in 3 bits with a level of their own.
//!
//! A block has [`BLOCK_BYTES`]: [`BLOCK_SAMPLES`] codes of 3 bits, the first in the lowest bits of the first byte, and
//! a byte with the block's level L, -128 to 0, in steps of 0.5 dB. A code stands for ± peak · 10^(L/40) · m: bit 2 is
//! set if the value is negative, and m = (5^((2k + 1)/7) - 1)/4, where k is the number in bits 0 and 1.

/// Samples of a block.
pub const BLOCK_SAMPLES: usize = 64;

/// Bytes of a block: the codes, then the level.
pub const BLOCK_BYTES: usize = 25;

/// Binary digits after the point of [`block_share`].
pub const SHARE_FRACTION_BITS: u32 = 30;

/// Magnitudes of the codes as fractions of the block's level, in steps of 2⁻¹⁴: (5^((2k + 1)/7) - 1)/4 within a step.
/// The second would be rounded to 4068. These four numbers, not the formula, are the format.
pub const BLOCK_MAGNITUDES: [i32; 4] = [1059, 4069, 8835, 16_384];

/// Values of the codes as fractions of the block's level, in steps of 2⁻¹⁴. A static, so that the image has a name
/// for it.
static VALUES: [i32; 8] = {
    let [a, b, c, d] = BLOCK_MAGNITUDES;
    [a, b, c, d, -a, -b, -c, -d]
};

/// Amplitudes of the levels 0 to -128, in steps of 2⁻¹⁶. Each is the square of a rounded root, and these numbers, not
/// the formula, are the format.
static SCALES: [u32; 129] = {
    // 10^(-1/80), by the series of the exponential, whose remainder is below 10⁻¹⁸.
    let x = -core::f64::consts::LN_10 / 80.0;
    let (mut term, mut step, mut n) = (1.0, 1.0, 1.0);
    while n < 13.0 {
        term *= x / n;
        step += term;
        n += 1.0;
    }
    let mut table = [0; 129];
    let (mut root, mut level) = (1.0, 0);
    while level <= 128 {
        let rounded = (root * 65_536.0 + 0.5) as u64;
        table[level] = ((rounded * rounded) >> 16) as u32;
        root *= step;
        level += 1;
    }
    table
};

/// Returns a block's level as a fraction of the codebook's peak, in steps of 2⁻¹⁶. A level above 0, which no library
/// has, counts as 0.
#[inline]
pub fn block_scale(level: i8) -> u32 {
    SCALES[usize::from(level.min(0).unsigned_abs())]
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
    scale * VALUES[code & 7]
}

/// Sums over samples, each as a fraction of the codebook's peak.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// Sum of the samples, in steps of 2⁻³⁰.
    sum: i64,
    /// Sum of their squares, in steps of 2⁻³².
    squares: u64,
    /// Number of samples.
    count: usize,
}

impl Sums {
    /// Adds the samples of a block. Returns false if the block's level is above 0.
    #[inline]
    pub fn add(&mut self, block: &[u8; BLOCK_BYTES]) -> bool {
        let level = block[BLOCK_BYTES - 1].cast_signed();
        let (mut sum, mut squares) = (0, 0);
        // Eight codes of 3 bits are three bytes. The byte of the level is the remainder.
        for &[a, b, c] in block.as_chunks::<3>().0 {
            let mut codes = u32::from_le_bytes([a, b, c, 0]);
            for _ in 0..8 {
                let value = VALUES[codes as usize & 7];
                sum += value;
                squares += i64::from(value) * i64::from(value);
                codes >>= 3;
            }
        }
        let scale = block_scale(level);
        self.sum += i64::from(scale) * i64::from(sum);
        // Shifted in two steps, because the whole product may have 66 digits.
        let scale = u64::from(scale);
        self.squares += (((scale * scale) >> 8) * squares.cast_unsigned()) >> 20;
        self.count += BLOCK_SAMPLES;
        level <= 0
    }

    /// Mean of the samples of a codebook with this `peak`, in standard deviations; 0 without samples.
    pub fn mean(&self, peak: f32) -> f32 {
        const UNIT: f32 = (1u64 << SHARE_FRACTION_BITS) as f32;
        peak * (self.sum as f32 / UNIT) / self.count.max(1) as f32
    }

    /// Mean square of these samples; 0 without samples.
    pub fn mean_square(&self, peak: f32) -> f32 {
        const UNIT: f32 = (1u64 << 32) as f32;
        peak * peak * (self.squares as f32 / UNIT) / self.count.max(1) as f32
    }
}
