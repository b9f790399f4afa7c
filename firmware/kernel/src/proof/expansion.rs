//! The values of a node's polynomial on an interval of frequency, as Taylor polynomials. [`super`] has formulas and
//! bounds.

use model_format::Coefficients;
use model_format::limits::MAX_EXPONENT;

use super::table::{FACTOR_BITS, FACTORS, STEPS_PER_TURN, TERMS, cosine, sine};
use super::units::UNIT_BITS;

/// Digits of n π/(2N) relative to π/2: n is a number of 256ths.
const INDEX_BITS: u32 = 8;

/// Largest n, in 256ths of π/2 per half interval.
pub(super) const MAX_INDEX: usize = 200;

/// Digits that a unit has more than a coefficient's step at the texture's exponent.
const GUARD_BITS: u32 = 10;

const _: () = assert!(MAX_EXPONENT as u32 <= GUARD_BITS && UNIT_BITS == 31 + GUARD_BITS);

/// An interval of the half circle, and the frequencies in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval {
    /// Index of the interval, below the number of them.
    pub index: usize,
    /// 256 divided by the number of intervals, both powers of two.
    pub stride: usize,
    /// c: half of the order, rounded up. At most [`MAX_INDEX`] / `stride`.
    pub half_order: usize,
}

/// Real and imaginary part of A e^(jωc) on an interval, as polynomials in -1 ≤ t ≤ 1; units of the proof.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expansion {
    pub real: [i64; TERMS],
    pub imaginary: [i64; TERMS],
}

impl Expansion {
    /// An expansion of nothing.
    pub const NONE: Self = Self {
        real: [0; TERMS],
        imaginary: [0; TERMS],
    };

    /// The expansion of the node with these coefficients, in a texture of `exponent`.
    pub fn new(coefficients: Coefficients<'_>, exponent: u32, interval: Interval) -> Self {
        // A texture's exponent is at most ten above a node's, which the guard digits make up for.
        let shift = |of_node: u8| GUARD_BITS - (exponent - u32::from(of_node));
        let one = 1i64 << (UNIT_BITS - exponent);
        match coefficients {
            Coefficients::Direct16 { exponent, codes } => {
                let shift = shift(exponent) + 16;
                Self::sum(one, interval, |tap| {
                    codes
                        .get(tap)
                        .map_or(0, |&code| i64::from(i16::from_le_bytes(code)) << shift)
                })
            }
            Coefficients::Direct32 { exponent, codes } => {
                let shift = shift(exponent);
                Self::sum(one, interval, |tap| {
                    codes
                        .get(tap)
                        .map_or(0, |&code| i64::from(i32::from_le_bytes(code)) << shift)
                })
            }
            Coefficients::Lattice { .. } => Self::NONE,
        }
    }

    /// The sums over n. `predictor` gives h(i + 1) for i, and 0 beyond the order.
    fn sum(one: i64, interval: Interval, predictor: impl Fn(usize) -> i64) -> Self {
        const HALF: usize = TERMS / 2;
        let centre = interval.half_order;
        // a(i) of A = Σ a(i) z⁻ⁱ.
        let a = |index: usize| match index.checked_sub(1) {
            None => one,
            Some(tap) => -predictor(tap),
        };
        // Two n at a time, so that sums are loaded and stored half as often.
        let chain = |sums: &mut [i64; HALF], mut terms: [i64; 2], squares: [u16; 2]| {
            for sum in sums {
                *sum += terms[0] + terms[1];
                for (term, square) in terms.iter_mut().zip(squares) {
                    *term = (*term * i64::from(square)) >> (2 * INDEX_BITS);
                }
            }
        };
        // The first term of each chain: of the sum's cosine and sine, and of the difference's.
        let firsts = |n: usize| {
            if n > centre {
                return [0; 4];
            }
            let step = n * (2 * interval.index + 1) * interval.stride % STEPS_PER_TURN;
            let (cosine, sine) = (cosine(step), sine(step));
            let (later, earlier) = (a(centre + n), a(centre - n));
            let (sum, difference) = (earlier + later, earlier - later);
            let index = (n * interval.stride) as i64;
            let odd = |value: i64, by: i32| (scaled(value, by, 31) * index) >> INDEX_BITS;
            [
                scaled(sum, cosine, 31),
                odd(sum, sine),
                scaled(difference, sine, 31),
                odd(difference, cosine),
            ]
        };
        // Largest of them is 200², which 16 bits hold.
        let square = |n: usize| ((n * interval.stride) * (n * interval.stride)) as u16;
        let mut sums = [[0; HALF]; 4];
        sums[0][0] = a(centre);
        for n in (1..=centre).step_by(2) {
            let (these, those) = (firsts(n), firsts(n + 1));
            let squares = [square(n), square(n + 1)];
            for (sums, terms) in sums.iter_mut().zip(these.into_iter().zip(those)) {
                chain(sums, [terms.0, terms.1], squares);
            }
        }
        let [even, odd, even_sine, odd_sine] = sums;
        let mut expansion = Self::NONE;
        for half in 0..HALF {
            let sign = if half % 2 == 0 { 1 } else { -1 };
            let term = |power: usize, sum: i64| scaled(sign * sum, FACTORS[power], FACTOR_BITS);
            expansion.real[2 * half] = term(2 * half, even[half]);
            expansion.real[2 * half + 1] = term(2 * half + 1, -odd[half]);
            expansion.imaginary[2 * half] = term(2 * half, even_sine[half]);
            expansion.imaginary[2 * half + 1] = term(2 * half + 1, odd_sine[half]);
        }
        expansion
    }
}

/// ⌊value · by / 2^bits⌋, with `bits` at most 32 and a result that fits.
#[inline(always)]
pub(super) fn scaled(value: i64, by: i32, bits: u32) -> i64 {
    let high = (value >> 32) * i64::from(by);
    let low = (value & 0xffff_ffff) * i64::from(by);
    (high << (32 - bits)) + (low >> bits)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn scaling_rounds_the_exact_product_down(value in -(1i64 << 49)..1 << 49, by: i32, bits in 30u32..=31) {
            let exact = (i128::from(value) * i128::from(by)) >> bits;
            prop_assert_eq!(i128::from(scaled(value, by, bits)), exact);
        }

        /// Against the sums in f64, whose own rounding is 1e-3 units here.
        #[test]
        fn an_expansion_is_within_its_bound(
            codes in prop::collection::vec(any::<i16>(), 0..=400), index in 0usize..256, t in -1.0f64..=1.0,
            few in prop::bool::ANY,
        ) {
            let codes = if few { &codes[..codes.len().min(9)] } else { &codes[..] };
            let half_order = codes.len().div_ceil(2);
            let intervals = super::super::row::Geometry::intervals_of(codes.len());
            let index = index % intervals;
            // As the kernel chooses it: a sum of magnitudes below 2^(E+1).
            let magnitude: f64 = codes.iter().map(|&h| f64::from(h).abs() / 32768.0).sum();
            let exponent = (0..=10).find(|&e| magnitude < f64::from(2u32 << e)).unwrap();
            let bytes: std::vec::Vec<[u8; 2]> = codes.iter().map(|code| code.to_le_bytes()).collect();
            let interval = Interval { index, stride: 256 / intervals, half_order };
            let stored = Coefficients::Direct16 { exponent: 0, codes: &bytes };
            let expansion = Expansion::new(stored, exponent as u32, interval);
            let omega = core::f64::consts::PI * (2.0 * index as f64 + 1.0 + t) / (2 * intervals) as f64;
            let unit = libm::exp2(41.0 - f64::from(exponent));
            let (mut real, mut imaginary) = (0.0, 0.0);
            let a = core::iter::once(1.0).chain(codes.iter().map(|&h| -f64::from(h) / 32768.0));
            for (i, a) in a.enumerate() {
                let angle = -omega * (i as f64 - half_order as f64);
                real += a * unit * libm::cos(angle);
                imaginary += a * unit * libm::sin(angle);
            }
            let value = |terms: &[i64; TERMS]| terms.iter().rev().fold(0.0, |sum, &b| sum * t + b as f64);
            let off = (value(&expansion.real) - real).abs().max((value(&expansion.imaginary) - imaginary).abs());
            prop_assert!(off <= 32768.0, "{} units", off);
        }
    }
}
