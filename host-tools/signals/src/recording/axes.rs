//! The columns of a table that contain accelerations, determined from their names. Loggers also write other quantities:
//! a gyroscope's axes, a friction coefficient, a temperature, or the magnitude of all axes.

use stylus_support::number::counted;

use super::rate::MAX_CHANNELS;
use super::unit::{self, Unit};

/// Words for the magnitude of all axes in a column's name, in lower case.
const MAGNITUDE_WORDS: [&str; 5] = ["absolute", "abs", "magnitude", "norm", "total"];

/// Words, in lower case, for a statistic of all axes in a column's name. ROS writes such columns next to accelerations.
const STATISTIC_WORDS: [&str; 4] = ["covariance", "variance", "std", "stddev"];

/// Columns of a table that do not contain an axis.
#[derive(Debug, Default, PartialEq)]
pub(super) struct LeftOut {
    /// Indices of the columns, ascending.
    columns: Vec<usize>,
    /// Reasons in words, one per kind.
    pub remarks: Vec<String>,
}

impl LeftOut {
    /// Evaluates `samples`, the columns of a header except those of times and motion, each as an index and a name.
    ///
    /// If some names are those of accelerations, columns without such a name or unit contain something else. If the
    /// header names no acceleration, it gives no information, so all its columns are kept. The one magnitude next to
    /// three axes is left out in either case.
    pub fn of(samples: &[(usize, &str)]) -> Self {
        let is_told = samples.iter().any(|(_, name)| is_acceleration(name));
        let is_axis = |name: &str| !is_told || is_acceleration(name) || has_unit(name);
        let (axes, others): (Vec<_>, Vec<_>) = samples.iter().copied().partition(|(_, name)| is_axis(name));
        let mut magnitudes = axes.iter().copied().filter(|(_, name)| is_magnitude(name));
        // With two magnitudes, it is open which three columns are the axes.
        let magnitude = match (magnitudes.next(), magnitudes.next()) {
            (Some(only), None) if axes.len() == MAX_CHANNELS + 1 => Some(only),
            _ => None,
        };
        let others_are = match others.as_slice() {
            [] => None,
            [(_, name)] => Some(format!("column '{name}' is")),
            [(_, name), more @ ..] => {
                let more = counted(more.len(), "other");
                Some(format!("column '{name}' and {more} are"))
            }
        };
        let other = others_are.map(|are| format!("{are} left out, because accelerations are named beside them"));
        let follows =
            magnitude.map(|(_, name)| format!("column '{name}' is left out, because it follows from the others"));
        let mut columns: Vec<usize> = others.iter().chain(&magnitude).map(|own| own.0).collect();
        columns.sort_unstable();
        Self {
            columns,
            remarks: follows.into_iter().chain(other).collect(),
        }
    }

    /// Number of columns that are left out.
    pub fn count(&self) -> usize {
        self.columns.len()
    }

    /// Returns true if the column of this index is left out.
    pub fn contains(&self, index: usize) -> bool {
        self.columns.binary_search(&index).is_ok()
    }
}

fn is_magnitude(name: &str) -> bool {
    words(&name.to_lowercase()).any(|word| MAGNITUDE_WORDS.contains(&word))
}

/// Returns true for a name whose unit is one of acceleration.
fn has_unit(name: &str) -> bool {
    matches!(unit::in_name(name), Some((Unit::Acceleration(_), _)))
}

/// Returns true for a name of an acceleration, such as `accel`, `Acc X`, `ax`, `a_y`, `z` or `X-Axis (g)`.
pub(super) fn is_acceleration(name: &str) -> bool {
    let lower = name.to_lowercase();
    let is_meant = |word: &str| {
        let axis = word.strip_prefix("acc").or(word.strip_prefix("gf"));
        word == "acc"
            || axis.is_some_and(|axis| ["x", "y", "z"].contains(&axis))
            || word.starts_with("accel")
            || word.starts_with("beschleunigung")
    };
    let is_statistic = |word: &str| {
        // ROS numbers the elements of a covariance.
        let word = word.trim_end_matches(|last: char| last.is_ascii_digit());
        STATISTIC_WORDS.contains(&word)
    };
    !words(&lower).any(is_statistic) && (words(&lower).any(is_meant) || is_axis(&lower))
}

/// Returns true for an axis in lower case, with nothing else but a unit of acceleration, volts or converter steps.
fn is_axis(lower: &str) -> bool {
    let is_sign = |c: char| !c.is_alphanumeric();
    let Some(rest) = lower
        .strip_prefix('a')
        .map_or(lower, |rest| rest.trim_start_matches(is_sign))
        .strip_prefix(['x', 'y', 'z'])
    else {
        return false;
    };
    // The first letter of another word, such as yaw, is not an axis.
    if rest.starts_with(char::is_alphanumeric) {
        return false;
    }
    let rest = rest.trim_matches(is_sign);
    let unit = rest.strip_prefix("axis").unwrap_or(rest).trim_matches(is_sign);
    unit.is_empty() || Unit::parse(unit).is_some_and(|unit| unit != Unit::Other)
}

fn words(lower: &str) -> impl Iterator<Item = &str> {
    lower.split(|c: char| !c.is_alphanumeric())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left_out(names: &[&str]) -> Vec<usize> {
        let samples: Vec<(usize, &str)> = names.iter().copied().enumerate().collect();
        LeftOut::of(&samples).columns
    }

    #[test]
    fn beside_named_accelerations_other_quantities_are_left_out() {
        for (names, others) in [
            (&["accel", "friction"][..], &[1][..]),
            (&["ax", "ay", "az", "gx", "gy", "gz"], &[3, 4, 5]),
            (&["temp", "Acc X [mg]", "Acc Y [mg]", "Acc Z [mg]", "accuracy"], &[0, 4]),
            (&["x", "y", "z", "yaw", "x_mm", "x (N)"], &[3, 4, 5]),
            (&["gFx", "gFy", "gFz", "TgF"], &[3]),
            (&["X-Axis (g's)", "a_y", "adc"], &[2]),
            (&["accelX", "x_g", "vibration (g)", "load (kPa)"], &[3]),
            (&["acc_x", "acc_y", "acc_z", "acc_total", "gyro_x"], &[3, 4]),
            (
                &["field.linear_acceleration.x", "field.linear_acceleration_covariance0"],
                &[1],
            ),
        ] {
            assert_eq!(left_out(names), others, "{names:?}");
        }
    }

    #[test]
    fn a_header_without_a_named_acceleration_keeps_all_columns() {
        for names in [
            &["ch1 [g]", "ch2", "ch3"][..],
            &["left", "right"],
            &["azimuth", "yaw", "x1"],
            &["acc1_x", "acc2_x", "a (m/s²)"],
        ] {
            assert_eq!(left_out(names), [0usize; 0], "{names:?}");
        }
    }
}
