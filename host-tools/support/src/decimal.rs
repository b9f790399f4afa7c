//! Numbers rounded to a number of decimals or digits, without negative zeros.

/// Returns `value` with `decimals` decimals. A value that rounds to zero has no sign: "0.0", never "-0.0".
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|digit| matches!(digit, '0' | '.')) => digits.to_owned(),
        _ => text,
    }
}

/// Returns the value rounded to four significant digits, which is more than anybody reads; 0 if it is not finite.
pub fn significant(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    // Powers of ten are exact up to 10²², and their inverses are not, so a division replaces a negative power.
    let factor = 10f64.powi(digits.abs());
    let rounded = if digits < 0 {
        (value / factor).round() * factor
    } else {
        (value * factor).round() / factor
    };
    // The smallest numbers have an infinite factor, and the largest may be rounded up to infinity.
    if rounded.is_finite() { rounded } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_written_number_is_that_number_and_zero_has_no_sign(
            value in prop_oneof![-1e-3..1e-3f64, -1e6..1e6f64], decimals in 0..6usize,
        ) {
            let text = fixed(value, decimals);
            let read: f64 = text.parse().unwrap();
            prop_assert!((read - value).abs() <= 0.51 * 0.1f64.powi(decimals as i32) + 1e-9);
            prop_assert_eq!(read < 0.0, text.starts_with('-'), "{}", text);
        }
    }

    #[test]
    fn what_is_no_number_stays_what_it_is() {
        assert_eq!(fixed(f64::NAN, 1), "NaN");
        assert_eq!(fixed(-0.04, 1), "0.0");
        assert_eq!(fixed(f64::NEG_INFINITY, 1), "-inf");
    }
}
