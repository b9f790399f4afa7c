//! Logarithm and power of two in fixed point, for levels that are averaged in dB.
//!
//! All arithmetic is in integers, so that every processor gives the same bits. Both together are within 10⁻⁵ dB, plus
//! the rounding of the power of two to a whole step.

use crate::fixed::high_word;

/// Digits after the point of a logarithm.
pub const LOG2_FRACTION_BITS: u32 = 24;

/// Digits after the point of the mantissas below.
const MANTISSA_BITS: u32 = 31;

/// Binary digits of an index into the tables of centres.
const CENTRE_BITS: u32 = 5;

/// Number of centres: 1, 1 + 2⁻⁵, 1 + 2 · 2⁻⁵, and so on up to 2.
const CENTRES: usize = (1 << CENTRE_BITS) + 1;

/// 1 / centre in steps of 2⁻³¹, rounded down.
const RECIPROCALS: [u32; CENTRES] = {
    let mut reciprocals = [0; CENTRES];
    let mut place = 0;
    while place < CENTRES {
        let centre = (1 << CENTRE_BITS) + place as u64;
        reciprocals[place] = ((1u64 << (MANTISSA_BITS + CENTRE_BITS)) / centre) as u32;
        place += 1;
    }
    reciprocals
};

/// log₂ of the inverse of each of [`RECIPROCALS`] as they are stored, in steps of 2⁻³¹, rounded down.
const LOGARITHMS: [u32; CENTRES] = {
    let mut logarithms = [0; CENTRES];
    let mut place = 0;
    while place < CENTRES {
        let centre = (1u64 << MANTISSA_BITS) as f64 / RECIPROCALS[place] as f64;
        // ln c = 2 artanh z with z = (c - 1) / (c + 1), at most a third, as a series in z².
        let z = (centre - 1.0) / (centre + 1.0);
        let (mut sum, mut term, mut n) = (0.0, 2.0 * z, 1);
        while n < 60 {
            sum += term / n as f64;
            term *= z * z;
            n += 2;
        }
        logarithms[place] = (sum / core::f64::consts::LN_2 * (1u64 << MANTISSA_BITS) as f64) as u32;
        place += 1;
    }
    logarithms
};

/// Digits after the point of a mantissa's distance from its centre, relative to the centre. The distance is at most 2⁻⁶
/// in magnitude.
const DISTANCE_BITS: u32 = 36;

/// (-1)ⁿ⁺¹ / (n ln 2) for n of 1 to 4, in steps of 2⁻²⁹: the series of log₂(1 + x), whose remainder is below 10⁻⁹ for x
/// up to 2⁻⁶.
const LOG2_SERIES: [i32; 4] = {
    let mut series = [0; 4];
    let (mut n, mut sign) = (1, 1.0);
    while n <= series.len() {
        let coefficient = sign / (n as f64 * core::f64::consts::LN_2);
        series[n - 1] = (coefficient * (1u32 << SERIES_BITS) as f64) as i32;
        n += 1;
        sign = -sign;
    }
    series
};

/// Digits after the point of [`LOG2_SERIES`].
const SERIES_BITS: u32 = 29;

/// log₂ of `value` in steps of 2⁻²⁴, rounded down, for a positive finite `value`. It is within two steps of the exact
/// logarithm, exact for powers of two, and larger for every larger value.
///
/// Zero counts as the smallest positive value. The mantissa is the nearest centre times 1 + x, and log₂(1 + x) is
/// computed as a series.
pub fn log2(value: f32) -> i64 {
    const STORED_BITS: u32 = f32::MANTISSA_DIGITS - 1;
    /// Exponent of a value's lowest stored digit if the exponent field is 0 or 1.
    const LOWEST: i32 = f32::MIN_EXP - f32::MANTISSA_DIGITS as i32;
    // Without the sign, so that -0.0 is zero.
    let bits = value.to_bits() & (u32::MAX >> 1);
    let field = bits >> STORED_BITS;
    let hidden = u32::from(field > 0) << STORED_BITS;
    let digits = ((bits & ((1 << STORED_BITS) - 1)) | hidden).max(1);
    // `value` is mantissa · 2^exponent with a mantissa from 1 to 2.
    let exponent = LOWEST + field.max(1) as i32 - 1 + digits.ilog2() as i32;
    let mantissa = digits << (MANTISSA_BITS - digits.ilog2());
    // One binary digit more than the index has, rounded off.
    let halves = (mantissa >> (MANTISSA_BITS - CENTRE_BITS - 1)) - (2 << CENTRE_BITS);
    let place = halves.div_ceil(2) as usize;
    let ratio = u64::from(mantissa) * u64::from(RECIPROCALS[place]);
    let distance = ((ratio >> (2 * MANTISSA_BITS - DISTANCE_BITS)) as i64 - (1 << DISTANCE_BITS)) as i32;
    let scaled = |sum: i32| high_word(i64::from(sum) * i64::from(distance));
    let mut sum = 0;
    for coefficient in LOG2_SERIES.into_iter().rev() {
        sum = coefficient + (scaled(sum) >> (DISTANCE_BITS - u32::BITS));
    }
    let of_distance = scaled(sum) >> (SERIES_BITS + DISTANCE_BITS - u32::BITS - MANTISSA_BITS);
    let fraction = LOGARITHMS[place].wrapping_add_signed(of_distance) >> (MANTISSA_BITS - LOG2_FRACTION_BITS);
    (i64::from(exponent) << LOG2_FRACTION_BITS) + i64::from(fraction)
}

/// 2^(`exponent` · 2⁻`fraction_bits`), rounded down, at most `u32::MAX`; `fraction_bits` are 32 to 62.
///
/// The result never falls while `exponent` rises, because all terms of the series are positive and rounded down.
pub fn exp2(exponent: i64, fraction_bits: u32) -> u32 {
    let whole = exponent >> fraction_bits;
    let fraction = (exponent - (whole << fraction_bits)) as u64;
    let mantissa = exp2_of_fraction((fraction >> (fraction_bits - 32)) as u32);
    match whole {
        0..=31 => (mantissa >> (i64::from(MANTISSA_BITS) - whole)) as u32,
        32.. => u32::MAX,
        _ => 0,
    }
}

/// 2^x in steps of 2⁻³¹, for x in steps of 2⁻³²; the result is at least 1 and below 2.
fn exp2_of_fraction(x: u32) -> u64 {
    let mut sum = 0;
    for coefficient in EXP2_SERIES.into_iter().rev() {
        sum = coefficient + ((sum * u64::from(x)) >> 32);
    }
    sum
}

/// (ln 2)ⁿ / n! in steps of 2⁻³¹: the series of 2^x, whose remainder is below 10⁻⁸ for x below 1.
const EXP2_SERIES: [u64; 10] = {
    let mut series = [0; 10];
    let (mut n, mut term) = (0, 1.0);
    while n < series.len() {
        series[n] = (term * (1u64 << MANTISSA_BITS) as f64) as u64;
        n += 1;
        term *= core::f64::consts::LN_2 / n as f64;
    }
    series
};

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: f64 = 1.0 / (1u32 << LOG2_FRACTION_BITS) as f64;

    proptest! {
        #[test]
        fn exp2_is_the_power_of_two_to_a_step_and_ten_parts_in_a_thousand_million(
            exponent in -(2i64 << 40)..31i64 << 40,
        ) {
            let exact = libm::exp2(exponent as f64 / (1u64 << 40) as f64);
            let error = exact - f64::from(exp2(exponent, 40));
            prop_assert!((-1e-9 * exact..=1.0 + 1e-8 * exact).contains(&error), "{exponent}: {error}");
        }

        #[test]
        fn exp2_never_falls(exponent in -(2i64 << 40)..32i64 << 40, more in 0i64..1 << 20) {
            prop_assert!(exp2(exponent, 40) <= exp2(exponent + more, 40));
        }
    }

    /// All mantissas at one exponent; logarithms at other exponents differ by whole numbers.
    #[test]
    fn log2_is_larger_for_every_larger_value_and_within_two_steps_of_the_exact_one() {
        let mut before = log2(1.0) - 1;
        for mantissa in 0..1u32 << (f32::MANTISSA_DIGITS - 1) {
            let value = f32::from_bits(1.0f32.to_bits() + mantissa);
            let found = log2(value);
            assert!(found > before, "{value}: {found} after {before}");
            let error = found as f64 * STEP - libm::log2(f64::from(value));
            assert!((-2.0 * STEP..=1e-9).contains(&error), "{value}: {error}");
            before = found;
        }
        assert!(log2(2.0) > before);
    }

    #[test]
    fn powers_of_two_are_exact_and_the_ends_are_kept() {
        for exponent in -149..=127 {
            let value = libm::exp2(f64::from(exponent)) as f32;
            assert_eq!(log2(value), i64::from(exponent) << LOG2_FRACTION_BITS);
        }
        assert_eq!(log2(0.0), -149 << LOG2_FRACTION_BITS);
        for exponent in 0..32 {
            assert_eq!(exp2(exponent << 40, 40), 1 << exponent);
            assert!(exp2((exponent << 40) - 1, 40) < 1 << exponent);
        }
        assert_eq!(exp2(-1, 40), 0);
        assert_eq!(exp2(32 << 40, 40), u32::MAX);
    }
}
