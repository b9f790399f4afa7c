//! Measured speeds and forces, moved to the nominal values that they are meant to be.
//!
//! A grid has a line of nodes for every value that a list has. Measured values are all different, so that twenty trials
//! make a grid of 20 x 20 nodes, of which 380 are filled from neighbours. Values that are closer to each other than a
//! tolerance are taken for one here; it is the roundest number within them that none is farther from than the
//! tolerance. A value without neighbours stays as it is.

use std::collections::HashSet;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::set::RecordingSet;
use crate::support::error::{Error, Result};
use crate::support::number::tolerance;

/// The way in which measured values move to nominal ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Snap {
    /// By at most this share of each.
    Within(f64),
    /// To the grid that each texture's values fall into by their gaps.
    ByGaps(ByGaps),
}

/// The word for [`Snap::ByGaps`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ByGaps {
    /// The grid that each texture's values fall into.
    Auto,
}

impl FromStr for Snap {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::ByGaps(ByGaps::Auto)),
            _ => tolerance(text)
                .map(Self::Within)
                .map_err(|fault| format!("{fault}, or auto")),
        }
    }
}

impl fmt::Display for Snap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(share) => share.fmt(f),
            Self::ByGaps(ByGaps::Auto) => f.write_str("auto"),
        }
    }
}

/// Gaps below this are the scatter of one value, as differences of natural logarithms.
const SCATTER: f64 = 0.002;

/// Gap beyond which values are not one value, measured several times, as a difference of natural logarithms.
const APART: f64 = 0.25;

/// Least ratio of the gaps between nominal values to those within one.
const LEAST_RATIO: f64 = 1.5;

/// Largest share by which a value moves to the middle of those that are near to it.
const MOST: f64 = 0.25;

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

/// Finds the grid that measured speeds and forces, in pairs, fall into: the one at least half of whose places were
/// measured, and whose values are the clearest apart; `None` if there is none.
///
/// Values are cut at their largest gaps. How clear a cut is, the ratio of its least gap to the largest that is left
/// tells.
pub fn grid_by_gaps(places: &[(f64, f64)]) -> Option<(Nominal, Nominal)> {
    let (speeds, forces): (Vec<f64>, Vec<f64>) = places.iter().copied().unzip();
    let (speeds, forces) = (cuts(&speeds), cuts(&forces));
    let pairs = speeds
        .iter()
        .flat_map(|speed| forces.iter().map(move |force| (speed, force)));
    let is_dense = |((_, speed), (_, force)): &(&(f64, Nominal), &(f64, Nominal))| {
        let moved = places
            .iter()
            .map(|&(v, f)| (speed.of(v).to_bits(), force.of(f).to_bits()));
        let measured = moved.collect::<HashSet<_>>().len();
        2 * measured >= speed.values().len() * force.values().len()
    };
    let clearest = pairs.filter(is_dense).max_by(|a, b| {
        let clear = |pair: &(&(f64, Nominal), &(f64, Nominal))| pair.0.0 * pair.1.0;
        clear(a).total_cmp(&clear(b))
    });
    clearest.map(|(speed, force)| (speed.1.clone(), force.1.clone()))
}

/// The ways to take neighbouring `values` for one, by cuts at the largest gaps, each with how clear it is.
fn cuts(values: &[f64]) -> Vec<(f64, Nominal)> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    // Zero is rest or no contact, and near to nothing.
    let gap = |pair: &[f64]| {
        if pair[0] > 0.0 {
            (pair[1] / pair[0]).ln()
        } else {
            f64::MAX
        }
    };
    let mut gaps: Vec<f64> = sorted.windows(2).map(gap).collect();
    gaps.sort_by(|a, b| b.total_cmp(a));
    let cut = |count: usize| {
        let between = count.checked_sub(1).map_or(APART, |last| gaps[last]);
        let within = gaps.get(count).copied().unwrap_or(0.0);
        let clear = between / within.max(SCATTER);
        let mut moves = Vec::with_capacity(sorted.len());
        for cluster in sorted.chunk_by(|a, b| gap(&[*a, *b]) < between || *a >= *b) {
            let (least, largest) = (cluster[0], cluster[cluster.len() - 1]);
            let half = (largest - least) / (largest + least).max(f64::MIN_POSITIVE);
            let to = centre(cluster, (1.5 * half).max(0.02)).ok()?;
            if half > MOST {
                return None;
            }
            moves.extend(cluster.iter().map(|&from| (from, to)));
        }
        (clear >= LEAST_RATIO).then_some((clear, Nominal { moves }))
    };
    (0..=gaps.len()).filter_map(cut).collect()
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
    /// Returns the set with the speeds and forces of each texture moved to nominal values, and a line for each texture
    /// of which something was moved. By gaps, a texture whose values fall into no grid stays as it is.
    ///
    /// # Errors
    /// Values that a tolerance does not tell apart.
    pub fn snapped(mut self, snap: Snap) -> Result<(Self, Vec<String>)> {
        let groups = self.by_texture().into_iter();
        let groups: Vec<(String, Vec<usize>)> = groups
            .map(|(name, members)| (name.to_owned(), members))
            .collect();
        let mut lines = Vec::new();
        for (name, members) in groups {
            let places: Vec<(f64, f64)> = (members.iter().map(|&member| &self.trials[member]))
                .map(|trial| (trial.speed_mm_s, trial.force_n))
                .collect();
            let found = match snap {
                Snap::Within(tolerance) => Some(within(&name, &places, tolerance)?),
                Snap::ByGaps(ByGaps::Auto) => grid_by_gaps(&places),
            };
            let Some((speeds, forces)) = found else {
                continue;
            };
            for &member in &members {
                let trial = &mut self.trials[member];
                trial.measured_speed_mm_s.get_or_insert(trial.speed_mm_s);
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

/// The nominal speeds and forces of the `places` of texture `name` to within `tolerance`.
fn within(name: &str, places: &[(f64, f64)], tolerance: f64) -> Result<(Nominal, Nominal)> {
    let found = |what: &str, unit: &str, values: Vec<f64>| {
        nominal(&values, tolerance).map_err(|spread| {
            Error::Request(format!(
                "texture '{name}': {what} from {} to {} {unit} have no gap between them at a tolerance of \
                 {tolerance}, and extend over more than it: give a smaller --snap, --snap auto, or nominal values",
                spread.least, spread.largest
            ))
        })
    };
    let (speeds, forces) = places.iter().copied().unzip();
    Ok((
        found("speeds", "mm/s", speeds)?,
        found("forces", "N", forces)?,
    ))
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

    /// Places of a grid whose values are each measured to within `share`.
    fn measured(speeds: &[f64], forces: &[f64], share: f64) -> Vec<(f64, f64)> {
        let mut off = (1..).map(|n| 1.0 + share * (f64::from(n * 7 % 19) / 9.0 - 1.0));
        let mut places = Vec::new();
        for speed in speeds {
            for force in forces {
                places.push((speed * off.next().unwrap(), force * off.next().unwrap()));
            }
        }
        places
    }

    #[test]
    fn the_grid_that_was_meant_is_found_by_the_gaps_of_each_axis() {
        // Forces scatter by more than speeds, and are further apart.
        let places = measured(&[20.0, 30.0, 40.0, 60.0], &[0.5, 1.0, 2.0], 0.06);
        let (speeds, forces) = grid_by_gaps(&places).unwrap();
        for (found, meant) in speeds.values().iter().zip([20.0, 30.0, 40.0, 60.0]) {
            assert!((found / meant - 1.0).abs() < 0.06, "{found} {meant}");
        }
        assert_eq!(speeds.values().len(), 4);
        assert_eq!((forces.values().len(), forces.of(places[0].1)), (3, 0.5));
        let (speeds, forces) = grid_by_gaps(&measured(&[50.0, 100.0], &[1.0], 0.01)).unwrap();
        assert_eq!((speeds.values().len(), forces.values()), (2, vec![1.0]));
    }

    #[test]
    fn a_nominal_grid_stays_and_a_hand_that_was_anywhere_has_none() {
        let nominal = measured(&[20.0, 24.0, 30.0], &[0.5, 0.6, 0.8], 0.0);
        let (speeds, forces) = grid_by_gaps(&nominal).unwrap();
        assert_eq!((speeds.largest_move(), forces.largest_move()), (0.0, 0.0));
        let anywhere: Vec<(f64, f64)> = (0..30)
            .map(|n| {
                (
                    20.0 + 5.0 * f64::from(n * 11 % 30),
                    0.3 + 0.1 * f64::from(n * 7 % 30),
                )
            })
            .collect();
        assert!(grid_by_gaps(&anywhere).is_none());
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
