//! Measured speeds and forces, moved to the nominal values that they are meant to be.
//!
//! A grid has a line of nodes for every value that a list has. Measured values are all different, so that twenty trials
//! make a grid of 20 x 20 nodes, of which 380 are filled from neighbours. Values that are closer to each other than a
//! tolerance are taken for one here; it is the roundest number within them that none is farther from than the
//! tolerance. A value without neighbours stays as it is.

use super::set::RecordingSet;
use crate::support::error::{Error, Result};

/// Digits of a number of double precision, at most.
const MOST_DIGITS: usize = 17;

/// Measured values with the nominal value of each, as [`nominal`] finds them.
#[derive(Clone, Debug, PartialEq)]
pub struct Nominal {
    /// Each measured value, ascending, with its nominal one.
    pub moves: Vec<(f64, f64)>,
}

/// Values that lie too closely to each other to be told apart by a tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Least of the values.
    pub least: f64,
    /// Largest of the values.
    pub largest: f64,
}

/// Finds the nominal values of `values`, none of which is negative, to within `tolerance`, a share of each.
///
/// # Errors
/// Values without a gap of the tolerance between them that extend over more than twice the tolerance.
pub fn nominal(values: &[f64], tolerance: f64) -> std::result::Result<Nominal, Spread> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let is_one = |a: &f64, b: &f64| b - a <= tolerance * a;
    let mut moves = Vec::with_capacity(sorted.len());
    for cluster in sorted.chunk_by(is_one) {
        let to = centre(cluster, tolerance)?;
        moves.extend(cluster.iter().map(|&from| (from, to)));
    }
    Ok(Nominal { moves })
}

/// The roundest number within `cluster`, ascending, from which each of it is at most `tolerance` away.
fn centre(cluster: &[f64], tolerance: f64) -> std::result::Result<f64, Spread> {
    let (least, largest) = (cluster[0], cluster[cluster.len() - 1]);
    if cluster.len() == 1 {
        return Ok(least);
    }
    let low = least.max(largest / (1.0 + tolerance));
    let high = largest.min(least / (1.0 - tolerance));
    if low > high {
        return Err(Spread { least, largest });
    }
    let mean = cluster.iter().sum::<f64>() / cluster.len() as f64;
    let mean = mean.clamp(low, high);
    let rounded = |digits: usize| format!("{mean:.digits$e}").parse().unwrap_or(mean);
    let round = (0..MOST_DIGITS).map(rounded);
    Ok(round
        .into_iter()
        .find(|value| (low..=high).contains(value))
        .unwrap_or(mean))
}

impl Nominal {
    /// The nominal value of `value`.
    pub fn of(&self, value: f64) -> f64 {
        let index = self.moves.partition_point(|&(from, _)| from < value);
        self.moves.get(index).map_or(value, |&(_, to)| to)
    }

    /// The nominal values, ascending.
    pub fn values(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.moves.iter().map(|&(_, to)| to).collect();
        values.dedup();
        values
    }

    /// The largest move, as a share of the nominal value.
    pub fn largest_move(&self) -> f64 {
        let shares = self.moves.iter().filter(|(_, to)| *to > 0.0);
        shares
            .map(|(from, to)| (from - to).abs() / to)
            .fold(0.0, f64::max)
    }

    /// The moves in words; none if nothing was moved.
    fn in_words(&self, what: &str, unit: &str) -> Option<String> {
        let values = self.values();
        let moved = self.moves.iter().filter(|(from, to)| from != to);
        let farthest = moved.max_by(|a, b| {
            let share = |&&(from, to): &&(f64, f64)| (from - to).abs() / to;
            share(a).total_cmp(&share(b))
        });
        let (from, to) = farthest?;
        let shown: Vec<String> = values.iter().map(f64::to_string).collect();
        Some(format!(
            "{} {what} become {} ({} {unit}), moved by {:.2} % at most ({from} to {to} {unit})",
            self.moves.len(),
            values.len(),
            shown.join(", "),
            100.0 * self.largest_move()
        ))
    }
}

impl RecordingSet {
    /// Returns the set with the speeds and forces of each texture moved to nominal values by at most `tolerance`, a
    /// share of each, and a line for each texture of which something was moved.
    ///
    /// # Errors
    /// Values that the tolerance does not tell apart.
    pub fn snapped(mut self, tolerance: f64) -> Result<(Self, Vec<String>)> {
        let groups = self.by_texture().into_iter();
        let groups: Vec<(String, Vec<usize>)> = groups
            .map(|(name, members)| (name.to_owned(), members))
            .collect();
        let mut lines = Vec::new();
        for (name, members) in groups {
            let found = |what: &str, unit: &str, of: &dyn Fn(usize) -> f64| {
                let values: Vec<f64> = members.iter().map(|&member| of(member)).collect();
                nominal(&values, tolerance).map_err(|spread| {
                    Error::Request(format!(
                        "texture '{name}': {what} from {} to {} {unit} have no gap between them at a tolerance of \
                         {tolerance}, and extend over more than it: give a smaller --snap, or nominal values",
                        spread.least, spread.largest
                    ))
                })
            };
            let speeds = found("speeds", "mm/s", &|member| self.trials[member].speed_mm_s)?;
            let forces = found("forces", "N", &|member| self.trials[member].force_n)?;
            for &member in &members {
                let trial = &mut self.trials[member];
                trial.speed_mm_s = speeds.of(trial.speed_mm_s);
                trial.force_n = forces.of(trial.force_n);
            }
            let words = [
                speeds.in_words("speeds", "mm/s"),
                forces.in_words("forces", "N"),
            ];
            let words: Vec<String> = words.into_iter().flatten().collect();
            if !words.is_empty() {
                lines.push(format!("texture '{name}': {}", words.join("; ")));
            }
        }
        Ok((self, lines))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn measured_values_become_the_round_ones_that_they_are_near() {
        let measured = [98.7, 101.2, 100.4, 49.1, 50.6, 0.0, 203.0];
        let found = nominal(&measured, 0.04).unwrap();
        assert_eq!(found.values(), [0.0, 50.0, 100.0, 203.0]);
        assert_eq!(found.of(98.7), 100.0);
        assert!((found.largest_move() - 0.018).abs() < 1e-9, "49.1 to 50");
        // Less is moved with a smaller tolerance, and nothing where all is told apart.
        assert_eq!(nominal(&measured, 1e-4).unwrap().largest_move(), 0.0);
        assert_eq!(nominal(&[100.0, 100.0001], 0.01).unwrap().values(), [100.0]);
    }

    #[test]
    fn values_without_a_gap_are_refused() {
        let slope: Vec<f64> = (0..20).map(|n| 100.0 + f64::from(n)).collect();
        let spread = nominal(&slope, 0.02).unwrap_err();
        assert_eq!((spread.least, spread.largest), (100.0, 119.0));
        assert_eq!(nominal(&slope, 0.1).unwrap().values().len(), 1);
    }

    proptest! {
        #[test]
        fn nothing_moves_farther_than_the_tolerance_and_the_order_stays(
            values in prop::collection::vec(prop_oneof![Just(0.0), 0.01..1e4f64, 99.0..101.0f64], 1..40),
            tolerance in 1e-4..0.25f64,
        ) {
            let Ok(found) = nominal(&values, tolerance) else { return Ok(()) };
            prop_assert!(found.largest_move() <= tolerance * (1.0 + 1e-9));
            prop_assert!(found.moves.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 <= pair[1].1));
            for value in &values {
                let to = found.of(*value);
                prop_assert!((to - value).abs() <= tolerance * to.max(*value) * (1.0 + 1e-9));
            }
            // What is nominal stays.
            let again = nominal(&found.values(), tolerance);
            if let Ok(again) = again {
                prop_assert!(again.values().len() <= found.values().len());
            }
        }
    }
}
