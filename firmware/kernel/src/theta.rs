//! Bilinear interpolation of θ = arcsin k over the grid.
//!
//! One pass over the codes of four nodes gives their weighted sum, in steps of which
//! [`SUM_QUARTER_TURN`] are π/2. Each product of a weight and a code loses less than one of these steps, 2.6·10⁻⁹ rad.
//! The sum is then rounded to eight of them, so that the mean of equal angles is exactly that angle. A mean of angles
//! below π/2 is below π/2 by thousands of such steps, so that every mean of stable lattices is stable.
//!
//! Stages are interpolated in **runs** that all four nodes store alike. A node that lacks the stages of a run, because
//! its order is lower, has the weight 0 there and another node's codes, so that a run needs no case for it.

use crate::fixed::high_product;
use crate::grid::ONE;
use crate::rotation::{Rotation, SPARE_BITS, SUM_PER_THETA, SUM_QUARTER_TURN, THETA_FRACTION_BITS};

/// Factor of a node's weight for its codes: steps of a sum per code, as a product with a code loses 16 bits.
pub const PER_CODE: u32 = (SUM_PER_THETA as u32) << THETA_FRACTION_BITS;

/// Factor for fractions of codes.
pub const PER_FRACTION: u32 = SUM_PER_THETA as u32;

/// Start of a sum whose last three digits are dropped: four products with codes and four with fractions lose less than
/// 8.
pub const BIAS: i32 = 7;

/// Start of a sum of a tail: four products lose less than 6 or gain less than 2, because their factors are rounded down
/// too.
pub const TAIL_BIAS: i32 = 5;

const _: () = assert!(BIAS >> SPARE_BITS == 0);

/// The largest factor and weight make a positive word.
const _: () = assert!(PER_CODE as u64 * ONE as u64 <= i32::MAX as u64);

/// A code of all steps is a quarter turn.
const _: () = assert!(PER_CODE << 15 == SUM_QUARTER_TURN as u32);

/// Stages of the four nodes around a motion that all of them store alike, with the same number of stages in each slice.
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
        /// Factors of the fractions, by node: a product loses 16 bits.
        factors: [i32; 4],
    },
    /// Codes of one byte, in steps of each node's own.
    Tail {
        /// Codes, `i8`, by node.
        codes: [&'a [u8]; 4],
        /// Factors of the codes, by node, steps included: a product loses 8 bits.
        factors: [i32; 4],
    },
}

/// Codes of 16 bits of four nodes.
#[derive(Clone, Copy, Debug)]
pub struct Codes<'a> {
    /// Codes, `i16`, by node.
    pub codes: [&'a [[u8; 2]]; 4],
    /// Factors of the codes, by node. The sum takes each product of factor and code divided by 2¹⁶, rounded down.
    pub factors: [i32; 4],
}

impl Run<'_> {
    /// The stages after the first `stages`, of which there are as many or more.
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
/// Sums go to memory first, in the words that become negative sines, because one loop over both has too few registers
/// on ARM.
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

/// Two stages at a time, whose codes are one word.
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

    /// The sum of `stage`, from `start` on.
    fn sum(&self, start: i32, stage: usize) -> i32 {
        let codes = self.codes.map(|codes| i16::from_le_bytes(codes[stage]));
        sum(start, &self.factors, codes)
    }
}

fn byte(byte: u8) -> i16 {
    i16::from(byte.cast_signed())
}

/// `start` and the products of factors and codes, each truncated by itself, so that their order does not matter.
#[inline(always)]
fn sum(start: i32, factors: &[i32; 4], codes: [i16; 4]) -> i32 {
    let [a, b, c, d] = *factors;
    let [first, second, third, fourth] = codes;
    let sum = start + high_product(a, first) + high_product(b, second);
    sum + high_product(c, third) + high_product(d, fourth)
}
