//! Logarithm and power of two in fixed point, for levels that are averaged in dB.
//!
//! All is integer arithmetic, so that every processor gives the same bits. Both together are within 10⁻⁵ dB.

/// Digits after the point of a logarithm.
pub const LOG2_FRACTION_BITS: u32 = 24;

/// Digits after the point of the mantissas below.
const MANTISSA_BITS: u32 = 31;

/// log₂ of `value` in steps of 2⁻²⁴, rounded down, for a positive finite `value`. It is within two steps of the exact
/// one.
///
/// Zero counts as the smallest positive value.
pub fn log2(value: f32) -> i64 {
    const STORED_BITS: u32 = f32::MANTISSA_DIGITS - 1;
    /// Exponent of a value's lowest stored digit where the exponent field is 0 or 1.
    const LOWEST: i32 = f32::MIN_EXP - f32::MANTISSA_DIGITS as i32;
    let bits = value.to_bits() & (u32::MAX >> 1);
    let field = bits >> STORED_BITS;
    let hidden = u32::from(field > 0) << STORED_BITS;
    let digits = ((bits & ((1 << STORED_BITS) - 1)) | hidden).max(1);
    // `value` is mantissa · 2^exponent with a mantissa of 1 to 2.
    let exponent = LOWEST + field.max(1) as i32 - 1 + digits.ilog2() as i32;
    let mut mantissa = digits << (MANTISSA_BITS - digits.ilog2());
    // A digit of the logarithm is whether the square is 2 or more, which has the next digit twice as far up.
    let mut fraction = 0;
    for _ in 0..LOG2_FRACTION_BITS {
        let square = (u64::from(mantissa) * u64::from(mantissa)) >> MANTISSA_BITS;
        let digit = (square >> (MANTISSA_BITS + 1)) as u32;
        mantissa = (square >> digit) as u32;
        fraction = 2 * fraction + i64::from(digit);
    }
    (i64::from(exponent) << LOG2_FRACTION_BITS) + fraction
}

/// 2^(`exponent` · 2⁻`fraction_bits`), rounded down, at most `u32::MAX`; `fraction_bits` are 32 to 62.
///
/// It never falls where `exponent` rises, because all terms of the series are positive and rounded down.
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

/// 2^x in steps of 2⁻³¹, for x in steps of 2⁻³²: 1 up to less than 2.
fn exp2_of_fraction(x: u32) -> u64 {
    let mut sum = 0;
    for coefficient in EXP2_SERIES.into_iter().rev() {
        sum = coefficient + ((sum * u64::from(x)) >> 32);
    }
    sum
}

/// (ln 2)ⁿ / n! in steps of 2⁻³¹: the series of 2^x, whose rest is below 10⁻⁸ for x below 1.
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
        fn log2_is_within_two_steps_below_the_exact_one(bits in 1u32..0x7f80_0000) {
            let value = f32::from_bits(bits);
            let exact = libm::log2(f64::from(value));
            let error = log2(value) as f64 * STEP - exact;
            prop_assert!((-2.0 * STEP..=1e-9).contains(&error), "{value}: {error}");
        }

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
