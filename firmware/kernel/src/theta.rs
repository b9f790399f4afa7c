//! Bilinear interpolation of θ = arcsin k over the grid.
//!
//! One pass over the codes of four nodes gives their weighted sum, in steps of which [`SUM_QUARTER_TURN`] are π/2. Each
//! product of a weight and a code loses less than one of these steps, 2.6·10⁻⁹ rad. The sum is then rounded to a
//! multiple of eight steps, so that the mean of equal angles is exactly that angle. A mean of angles below π/2 is below
//! π/2 by thousands of steps, so that every mean of stable lattices is stable.
//!
//! Stages are interpolated in **runs** that all four nodes store in the same form. If a node lacks the stages of a run,
//! because its order is lower, it gets weight 0 there and another node's codes, so that a run needs no special case.

use crate::fixed::high_product;
use crate::grid::ONE;
use crate::rotation::{Rotation, SPARE_BITS, SUM_PER_THETA, SUM_QUARTER_TURN, THETA_FRACTION_BITS};

/// Factor of a node's weight for its codes: steps of a sum per code. A product loses 16 bits, which are the weight's.
pub const PER_CODE: u32 = (SUM_PER_THETA as u32) << THETA_FRACTION_BITS;

/// Factor for fractions of codes.
pub const PER_FRACTION: u32 = SUM_PER_THETA as u32;

/// Start of a sum whose last three binary digits are dropped: four products with codes and four with fractions lose
/// less than 8.
pub const BIAS: i32 = 7;

/// Start of a sum of a tail: four products lose less than 6 or gain less than 2, because their factors are rounded
/// down, too.
pub const TAIL_BIAS: i32 = 5;

const _: () = assert!(BIAS >> SPARE_BITS == 0);

/// The product of the largest factor and weight fits in a positive word.
const _: () = assert!(PER_CODE as u64 * ONE as u64 <= i32::MAX as u64);

/// A code of full scale is a quarter turn.
const _: () = assert!(PER_CODE << 15 == SUM_QUARTER_TURN as u32);

/// Stages that the four nodes around a motion store in the same form, with the same number of stages in each slice.
#[derive(Clone, Copy, Debug)]
pub enum Run<'a> {
    /// Codes of 16 bits.
    Codes(Codes<'a>),
    /// Codes of 16 bits with fractions.
    Fine {
        /// The codes.
        codes: Codes<'a>,
        /// Fractions, `i8`, by node.
        fractions: [&'a [u8]; 4],
        /// Factors of the fractions, by node: a product with a factor loses 16 bits.
        factors: [i32; 4],
    },
    /// Codes of one byte, in each node's own steps.
    Tail {
        /// Codes, `i8`, by node.
        codes: [&'a [u8]; 4],
        /// Factors of the codes, by node, including the node's step: a product with a factor loses 8 bits.
        factors: [i32; 4],
    },
}

/// Codes of 16 bits of four nodes.
#[derive(Clone, Copy, Debug)]
pub struct Codes<'a> {
    /// Codes, `i16`, by node.
    pub codes: [&'a [[u8; 2]]; 4],
    /// Factors of the codes, by node. Each product of factor and code is divided by 2¹⁶ and rounded down, then summed.
    pub factors: [i32; 4],
}

impl Run<'_> {
    /// The stages after the first `stages`; there must be at least that many.
    #[must_use]
    pub fn after(&self, stages: usize) -> Self {
        match *self {
            Self::Codes(codes) => Self::Codes(codes.after(stages)),
            Self::Fine {
                codes,
                fractions,
                factors,
            } => Self::Fine {
                codes: codes.after(stages),
                fractions: fractions.map(|fractions| &fractions[stages..]),
                factors,
            },
            Self::Tail { codes, factors } => Self::Tail {
                codes: codes.map(|codes| &codes[stages..]),
                factors,
            },
        }
    }
}

/// [`crate::arithmetic::Arithmetic::mean_rotations`] in plain Rust.
///
/// Sums are first written to memory, in the words that become negative sines, because one loop for both has too few
/// registers on ARM.
pub(crate) fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
    let stages = rotations.len();
    match run {
        Run::Codes(codes) => sums_of_codes(codes, rotations),
        Run::Fine {
            codes,
            fractions,
            factors,
        } => {
            sums_of_codes(codes, rotations);
            let fractions = fractions.map(|bytes| &bytes[..stages]);
            for (stage, rotation) in rotations.iter_mut().enumerate() {
                let bytes = fractions.map(|bytes| byte(bytes[stage]));
                rotation.neg_sin = sum(rotation.neg_sin, factors, bytes);
            }
        }
        Run::Tail { codes, factors } => {
            let codes = codes.map(|bytes| &bytes[..stages]);
            for (stage, rotation) in rotations.iter_mut().enumerate() {
                let bytes = codes.map(|bytes| byte(bytes[stage]) << 8);
                rotation.neg_sin = sum(TAIL_BIAS, factors, bytes);
            }
        }
    }
    for rotation in rotations {
        *rotation = Rotation::from_sum(rotation.neg_sin);
    }
}

/// Computes two stages at a time, because the codes of two stages are one word.
fn sums_of_codes(run: &Codes<'_>, rotations: &mut [Rotation]) {
    let stages = rotations.len();
    let (pairs, rest) = rotations.as_chunks_mut::<2>();
    let codes = run
        .codes
        .map(|codes| &codes[..stages].as_chunks::<2>().0[..pairs.len()]);
    for (index, pair) in pairs.iter_mut().enumerate() {
        let words = codes.map(|codes| {
            let [[low, high], [lower, higher]] = codes[index];
            i32::from_le_bytes([low, high, lower, higher])
        });
        pair[0].neg_sin = sum(BIAS, &run.factors, words.map(|word| word as i16));
        pair[1].neg_sin = sum(BIAS, &run.factors, words.map(|word| (word >> 16) as i16));
    }
    if let [rotation] = rest {
        rotation.neg_sin = run.sum(BIAS, stages - 1);
    }
}

impl Codes<'_> {
    fn after(&self, stages: usize) -> Self {
        Self {
            codes: self.codes.map(|codes| &codes[stages..]),
            factors: self.factors,
        }
    }

    /// Returns the sum of `stage`, beginning with `start`.
    fn sum(&self, start: i32, stage: usize) -> i32 {
        let codes = self.codes.map(|codes| i16::from_le_bytes(codes[stage]));
        sum(start, &self.factors, codes)
    }
}

fn byte(byte: u8) -> i16 {
    i16::from(byte.cast_signed())
}

/// `start` plus the products of factors and codes, each rounded down separately, so that their order does not matter.
#[inline(always)]
fn sum(start: i32, factors: &[i32; 4], codes: [i16; 4]) -> i32 {
    let [a, b, c, d] = *factors;
    let [first, second, third, fourth] = codes;
    let sum = start + high_product(a, first) + high_product(b, second);
    sum + high_product(c, third) + high_product(d, fourth)
}
