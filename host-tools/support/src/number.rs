//! Parsers of numbers with a range, for the text of an option.

use std::fmt::Display;

use super::hand::{force_fault, speed_fault};

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
