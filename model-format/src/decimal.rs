//! Formatting of numbers in messages, with integer arithmetic for the digits, because the core library's formatting of
//! floats takes 18 KB of an image.

use core::fmt;

/// A number, shown with six significant digits at most.
pub(crate) struct Decimal(pub f32);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = *self;
        if value.is_nan() {
            return f.write_str("NaN");
        }
        // The sign of -0 is shown, because -0 is refused where 0 is not.
        if value.is_sign_negative() {
            f.write_str("-")?;
        }
        if value.is_infinite() {
            return f.write_str("inf");
        }
        // The number is scaled to six digits and an exponent of ten. `f64` is precise enough for this.
        let (mut digits, mut exponent) = (f64::from(value).abs(), 0i32);
        if digits == 0.0 {
            return f.write_str("0");
        }
        // Half a digit is left at either bound, so that rounding never gives a seventh digit.
        while digits >= 999_999.5 {
            digits /= 10.0;
            exponent += 1;
        }
        while digits < 99_999.95 {
            digits *= 10.0;
            exponent -= 1;
        }
        let mut digits = (digits + 0.5) as u32;
        // Without zeros at the end, as the core library shows floats.
        while digits.is_multiple_of(10) {
            digits /= 10;
            exponent += 1;
        }
        match exponent {
            0..=9 => write!(f, "{digits}{:0>1$}", "", exponent as usize),
            // A tenth decimal place would need a power of ten beyond 32 bits.
            -9..0 => {
                let one = 10u32.pow(exponent.unsigned_abs());
                let places = exponent.unsigned_abs() as usize;
                write!(f, "{}.{:0places$}", digits / one, digits % one)
            }
            _ => write!(f, "{digits}e{exponent}"),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn numbers_have_the_text_that_floats_have_up_to_six_digits() {
        for value in [
            0.0,
            -0.0,
            1.0,
            -1.0,
            0.1,
            -0.25,
            2.5,
            10.0,
            60.0,
            100.0,
            0.001,
            0.00025,
            999_999.0,
            1e6,
            1.5e8,
            123.456,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::NAN,
        ] {
            assert_eq!(Decimal(value).to_string(), value.to_string());
        }
        assert_eq!(Decimal(1.0 / 3.0).to_string(), "0.333333");
        assert_eq!(Decimal(0.999_999_97).to_string(), "1");
        assert_eq!(Decimal(1e30).to_string(), "1e30");
        assert_eq!(Decimal(1.5e-20).to_string(), "15e-21");
    }
}
