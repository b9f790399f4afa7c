//! Numbers in texts: parsers with a range for options, bounds of the motion of a hand or a drum rig, counts with their
//! noun, and values rounded to decimals or digits without negative zeros.
//!
//! The bounds of a motion detect values in wrong units. A hand presses with tens of newtons and moves at a few metres
//! per second; drum rigs turn slower. A value ten times as large must be in another unit, such as grams instead of
//! newtons.

use std::fmt::Display;

/// Returns a count with its noun, in the plural unless the count is one.
///
/// ```
/// use stylus_support::number::counted;
/// assert_eq!(counted(1, "missed tick"), "1 missed tick");
/// assert_eq!([counted(0, "mute"), counted(2, "library")], ["0 mutes", "2 libraries"]);
/// assert_eq!(counted(2, "stretch"), "2 stretches");
/// ```
pub fn counted(count: impl Display, noun: &str) -> String {
    let count = count.to_string();
    match noun.strip_suffix('y') {
        _ if count == "1" => format!("{count} {noun}"),
        Some(stem) if !stem.ends_with(['a', 'e', 'o']) => format!("{count} {stem}ies"),
        _ if noun.ends_with("ch") => format!("{count} {noun}es"),
        _ => format!("{count} {noun}s"),
    }
}

/// Parses a finite number above zero.
///
/// # Errors
/// What the text must be, in words.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be a number above zero".into()),
    }
}

/// Parses a finite number that is not negative.
pub fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("must be a number that is not negative".into()),
    }
}

/// Parses the speed of a motion, in mm/s; its sign is the direction.
pub fn speed(text: &str) -> Result<f64, String> {
    within(text, speed_fault)
}

/// Parses the force of a motion, in N; at or below zero there is no contact.
pub fn force(text: &str) -> Result<f64, String> {
    within(text, force_fault)
}

/// Parses the speed of a recording, in mm/s, above zero.
pub fn recorded_speed(text: &str) -> Result<f64, String> {
    positive(text).and_then(|_| speed(text))
}

/// Parses the force of a recording, in N, above zero.
pub fn recorded_force(text: &str) -> Result<f64, String> {
    positive(text).and_then(|_| force(text))
}

fn within(text: &str, fault: fn(f64) -> Option<String>) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number".to_owned())?;
    fault(value).map_or(Ok(value), Err)
}

/// Parses a relative tolerance.
pub fn tolerance(text: &str) -> Result<f64, String> {
    /// With a larger tolerance, neighbouring nodes of an ordinary grid would count as the same node.
    const MOST: f64 = 0.25;
    match positive(text) {
        Ok(share) if share <= MOST => Ok(share),
        _ => Err(format!("must be a share above zero and at most {MOST}, such as 0.05")),
    }
}

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

/// Highest speed, mm/s.
pub const MAX_SPEED_MM_S: f64 = 10_000.0;

/// Highest force, N.
pub const MAX_FORCE_N: f64 = 100.0;

/// Returns, in words, what is wrong with a speed, in mm/s, that no hand and no drum reaches. The sign is the direction.
pub fn speed_fault(speed_mm_s: f64) -> Option<String> {
    // NaN is in no range.
    if speed_mm_s.abs() <= MAX_SPEED_MM_S {
        return None;
    }
    Some(format!(
        "a speed of {speed_mm_s} mm/s, and no hand or drum exceeds {MAX_SPEED_MM_S}: give it in mm/s"
    ))
}

/// Returns, in words, what is wrong with a normal force, in N, that no hand and no drum reaches. A negative force means
/// no contact.
pub fn force_fault(force_n: f64) -> Option<String> {
    if force_n.abs() <= MAX_FORCE_N {
        return None;
    }
    Some(format!(
        "a force of {force_n} N, and no hand or drum exceeds {MAX_FORCE_N}: give it in newtons (100 g press with 1 N)"
    ))
}

/// Returns, in words, what is wrong with a position, in mm, that exceeds the range of single precision.
pub fn position_fault(position_mm: f64) -> Option<String> {
    let is_finite = (position_mm as f32).is_finite();
    (!is_finite).then(|| "no path is as long: give it in mm".to_owned())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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

    #[test]
    fn what_a_hand_can_do_passes_in_both_directions_and_other_units_do_not() {
        for speed_mm_s in [0.0, -150.0, 5000.0, -MAX_SPEED_MM_S] {
            assert_eq!(speed_fault(speed_mm_s), None);
        }
        for force_n in [0.0, -0.3, 40.0, MAX_FORCE_N] {
            assert_eq!(force_fault(force_n), None);
        }
        for wrong in [1.2e5, -1.2e5, f64::NAN, f64::INFINITY] {
            assert!(speed_fault(wrong).is_some_and(|fault| fault.contains("mm/s")));
            assert!(force_fault(wrong).is_some_and(|fault| fault.contains("newtons")));
        }
    }
}
