//! White Gaussian excitation of unit variance from a seeded generator, on a fixed path of instructions.
//!
//! A permuted congruential generator (PCG-XSH-RR, period 2⁶⁴) gives 32 uniform bits per sample: one for the sign, 31
//! for the half-normal quantile. The quantile is read from a table with sixteen linear pieces in each octave of the
//! tail's probability. So its relative resolution is the same from the middle out to 6 σ, with no rejection and no
//! loop.
//!
//! The generator begins at the hash of the seed, because states that differ only in some of their higher bits would
//! give correlated noise.

use rand_core::Rng;
use rand_pcg::Pcg32;

/// Binary digits after the point of the excitation: one standard deviation is 2²⁸, an eighth of full scale.
pub const FRACTION_BITS: u32 = 28;

/// Linear pieces in an octave of probability, as a power of two.
const PIECES_LOG2: u32 = 4;
const PIECES: usize = 1 << PIECES_LOG2;
const OCTAVES: usize = 32;

/// Standard normal quantiles x(v) at the pieces' ends, where v/2³³ is the probability of exceeding x and
/// v = 2^octave · (1 + piece/16).
static QUANTILES: [i32; OCTAVES * PIECES + 1] = quantiles();

/// A seeded source of white Gaussian noise.
#[derive(Clone, Debug)]
pub struct Excitation {
    generator: Pcg32,
}

impl Excitation {
    /// A source that gives the same noise for the same seed, always and everywhere. Seeds that differ in any bit give
    /// uncorrelated noise.
    pub fn new(seed: u64) -> Self {
        /// Any odd increment gives the full period; this is PCG's own default stream.
        const STREAM: u64 = 0x0a02_bdbf_7bb3_c0a7;
        Self {
            generator: Pcg32::new(hashed(seed), STREAM),
        }
    }

    /// The next sample: mean 0, variance 1, in steps of 2⁻²⁸; at most 6.4 in magnitude.
    #[inline(always)]
    pub fn next_sample(&mut self) -> i32 {
        gaussian(self.generator.next_u32())
    }
}

/// A one-to-one hash of `seed`, in which each bit of the seed flips each bit of the result with probability 1/2: one
/// step of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
pub(crate) const fn hashed(seed: u64) -> u64 {
    // The sum keeps zero from being its own hash.
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Returns the Gaussian sample for 32 uniform bits.
#[inline(always)]
fn gaussian(bits: u32) -> i32 {
    const FRACTION: u32 = 16;
    // Odd, because zero has no octave.
    let v = bits << 1 | 1;
    let octave = v.ilog2();
    let mantissa = v << v.leading_zeros();
    // The remainder drops the leading one of the mantissa.
    let piece = (mantissa >> (31 - PIECES_LOG2)) as usize % PIECES;
    let fraction = (mantissa >> (31 - PIECES_LOG2 - FRACTION)) & ((1 << FRACTION) - 1);
    let index = (octave as usize % OCTAVES) * PIECES + piece;
    let (outer, inner) = (QUANTILES[index], QUANTILES[index + 1]);
    let magnitude = outer - ((i64::from(outer - inner) * i64::from(fraction)) >> FRACTION) as i32;
    // The top bit, which v does not hold, is the sign: a mask of ones negates.
    let sign = (bits as i32) >> 31;
    (magnitude ^ sign) - sign
}

/// The table, from the middle (x = 0 at v = 2³²) outwards, each entry by Newton's method from the previous one.
const fn quantiles() -> [i32; OCTAVES * PIECES + 1] {
    let mut table = [0; OCTAVES * PIECES + 1];
    let mut x = 0.0;
    let mut index = OCTAVES * PIECES;
    while index > 0 {
        index -= 1;
        let (octave, piece) = (index / PIECES, index % PIECES);
        let v = (1u64 << octave) as f64 * (1.0 + piece as f64 / PIECES as f64);
        let probability = v / (1u64 << 33) as f64;
        let mut iteration = 0;
        while iteration < 5 {
            let density = exp(-x * x / 2.0) * FRAC_1_SQRT_2PI;
            x += (upper_tail(x) - probability) / density;
            iteration += 1;
        }
        table[index] = (x * (1i64 << FRACTION_BITS) as f64 + 0.5) as i32;
    }
    table
}

const FRAC_1_SQRT_2PI: f64 = 0.398_942_280_401_432_7;

/// Probability that a standard normal variable exceeds `x` ≥ 0 (Abramowitz and Stegun 26.2.11 and 26.2.14).
const fn upper_tail(x: f64) -> f64 {
    let density = exp(-x * x / 2.0) * FRAC_1_SQRT_2PI;
    if x < 2.5 {
        // Φ(x) - 1/2 = φ(x) (x + x³/3 + x⁵/15 + ...)
        let (mut term, mut sum, mut odd) = (x, x, 3.0);
        while odd < 101.0 {
            term *= x * x / odd;
            sum += term;
            odd += 2.0;
        }
        0.5 - density * sum
    } else {
        // Q(x) = φ(x) / (x + 1/(x + 2/(x + 3/...)))
        let (mut fraction, mut level) = (x, 60.0);
        while level > 0.0 {
            fraction = x + level / fraction;
            level -= 1.0;
        }
        density / fraction
    }
}

/// eˣ for x ≤ 0, at compile time: the series for a small fraction of x, squared repeatedly.
const fn exp(x: f64) -> f64 {
    const HALVINGS: u32 = 8;
    let small = x / (1u32 << HALVINGS) as f64;
    let (mut term, mut sum, mut n) = (1.0, 1.0, 1.0);
    while n < 14.0 {
        term *= small / n;
        sum += term;
        n += 1.0;
    }
    let mut halving = 0;
    while halving < HALVINGS {
        sum *= sum;
        halving += 1;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: f64 = (1u32 << FRACTION_BITS) as f64;

    /// Probability that the magnitude exceeds `x`, computed by an independent library.
    fn two_sided_tail(x: f64) -> f64 {
        libm::erfc(x / core::f64::consts::SQRT_2)
    }

    #[test]
    fn every_quantile_of_the_table_is_that_of_the_error_function() {
        for (index, &quantile) in QUANTILES.iter().enumerate() {
            let (octave, piece) = (index / PIECES, index % PIECES);
            let v = libm::exp2(octave as f64) * (1.0 + piece as f64 / PIECES as f64);
            let probability = v / libm::exp2(32.0);
            let back = two_sided_tail(f64::from(quantile) / UNIT);
            assert!((back / probability - 1.0).abs() < 1e-6, "entry {index}");
        }
    }

    /// All 2³² inputs are too many for every run. Every 257th covers each piece of each octave that is long enough.
    #[test]
    fn moments_over_the_generators_range_are_those_of_a_standard_normal() {
        let (mut count, mut square, mut fourth) = (0.0, 0.0, 0.0);
        for bits in (0..=u32::MAX >> 1).step_by(257) {
            let (plus, minus) = (gaussian(bits), gaussian(bits | 1 << 31));
            assert_eq!(plus, -minus);
            let x = f64::from(plus) / UNIT;
            count += 1.0;
            square += x * x;
            fourth += x * x * x * x;
        }
        let variance = square / count;
        let kurtosis = fourth / count / variance / variance;
        assert!((variance - 1.0).abs() < 2e-4, "variance {variance}");
        assert!((kurtosis - 3.0).abs() < 2e-3, "kurtosis {kurtosis}");
    }

    /// The map from bits to magnitude falls monotonically, so that the tail beyond x has exactly the probability of
    /// the bits below its bound.
    #[test]
    fn tails_are_right_to_six_standard_deviations() {
        for x in [0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 4.5, 5.0, 5.5, 6.0] {
            let bound = (x * UNIT) as i32;
            let (mut low, mut high) = (0u32, 1 << 31);
            while low < high {
                let middle = low.midpoint(high);
                if gaussian(middle) > bound {
                    low = middle + 1;
                } else {
                    high = middle;
                }
            }
            let probability = f64::from(low) / libm::exp2(31.0);
            let tolerance = 1e-3 + 1.0 / f64::from(low);
            let ratio = probability / two_sided_tail(x);
            assert!((ratio - 1.0).abs() < tolerance, "beyond {x}: ratio {ratio}");
        }
        assert!(gaussian(0) > (6.0 * UNIT) as i32);
    }

    #[test]
    fn magnitudes_fall_with_rising_bits() {
        let mut before = i32::MAX;
        for bits in (0..1u32 << 16).chain((1 << 16..1 << 31).step_by(4099)) {
            let now = gaussian(bits);
            assert!(now <= before && now >= 0, "bits {bits}");
            before = now;
        }
    }

    #[test]
    fn noise_is_white() {
        const N: usize = 1 << 20;
        let mut source = Excitation::new(7);
        let mut recent = [0.0; 64];
        let mut products = [0.0; 64];
        for n in 0..N {
            let x = f64::from(source.next_sample()) / UNIT;
            recent[n % 64] = x;
            for (lag, product) in products.iter_mut().enumerate() {
                *product += x * recent[(n + 64 - lag) % 64];
            }
        }
        // Each correlation of white noise has standard deviation 1/√N.
        let bound = 4.5 / libm::sqrt(N as f64);
        for (lag, product) in products.iter().enumerate().skip(1) {
            let correlation = product / products[0];
            assert!(correlation.abs() < bound, "lag {lag}: {correlation}");
        }
    }

    /// The reference values of the generator's author, for the state 0.
    #[test]
    fn the_hash_is_splitmix64() {
        let step = 0x9e37_79b9_7f4a_7c15u64;
        assert_eq!(hashed(0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(hashed(step), 0x6e78_9e6a_a1b9_65f4);
        assert_eq!(hashed(step.wrapping_mul(2)), 0x06c4_5d18_8009_454f);
    }

    /// Correlation of the noise of two seeds at the same samples, in standard deviations of the correlation of
    /// independent noise.
    ///
    /// Without the hash, states that differ in one of the bits 51 to 58 rotate their outputs alike in one sample of 32,
    /// and correlate by 0.013 to 0.026, which is 6.5 to 13 standard deviations for this many samples.
    fn correlation(one: u64, other: u64) -> f64 {
        const N: usize = 1 << 18;
        let mut sources = [one, other].map(Excitation::new);
        let products = (0..N).map(|_| {
            let [one, other] = sources.each_mut().map(|source| f64::from(source.next_sample()) / UNIT);
            one * other
        });
        (products.sum::<f64>() / libm::sqrt(N as f64)).abs()
    }

    /// By chance the bound is exceeded once in 10⁹ correlations; each pair of seeds gives one correlation. The hash of
    /// a seed is the seed of a scene's second voice.
    #[test]
    fn related_seeds_give_uncorrelated_noise() {
        const BOUND: f64 = 6.1;
        for seed in [0u64, 0x0123_4567_89ab_cdef] {
            let bits = (0..u64::BITS).map(|bit| seed ^ (1 << bit));
            let next = (1..16).map(|n| seed.wrapping_add(n));
            let high = (1..16).map(|n| seed ^ (n << 60));
            for other in bits.chain(next).chain(high).chain([hashed(seed)]) {
                let found = correlation(seed, other);
                assert!(found < BOUND, "{seed:#x} and {other:#x}: {found}");
            }
        }
    }
}
