//! Moves measured speeds and forces to the nominal values that were intended.
//!
//! A grid has a line of nodes for every value in a list. Measured values are all different, so twenty trials make a
//! grid of 20 x 20 nodes, of which 380 are filled from neighbours. Here, values that are closer together than a
//! tolerance become one value. It is the roundest number within their range that is at most the tolerance away from
//! each of them. A value without neighbours stays the same.

use std::collections::HashSet;
use std::fmt;
use std::str::FromStr;

use model_format::limits::MAX_AXIS_LEN;
use serde::{Deserialize, Serialize};
use stylus_support::number::tolerance;
use stylus_support::{Error, Result};

use super::set::RecordingSet;

/// How measured values move to nominal values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Snap {
    /// Each value moves by at most this fraction of itself.
    Within(f64),
    /// Values move according to the gaps between each texture's values.
    By(Rule),
}

/// A rule that determines nominal values from gaps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The grid that [`clear_grid`] finds, which requires that the gaps leave no doubt.
    Clear,
    /// The grid that [`grid_by_gaps`] finds.
    Auto,
    /// No rule: every value stays.
    None,
}

impl Snap {
    /// Every value stays.
    pub const NONE: Self = Self::By(Rule::None);
}

impl Default for Snap {
    fn default() -> Self {
        Self::By(Rule::Clear)
    }
}

impl FromStr for Snap {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "clear" => Ok(Self::By(Rule::Clear)),
            "auto" => Ok(Self::By(Rule::Auto)),
            "none" => Ok(Self::NONE),
            _ => tolerance(text)
                .map(Self::Within)
                .map_err(|fault| format!("{fault}, or clear, auto or none")),
        }
    }
}

impl fmt::Display for Snap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(share) => share.fmt(f),
            Self::By(Rule::Clear) => f.write_str("clear"),
            Self::By(Rule::Auto) => f.write_str("auto"),
            Self::By(Rule::None) => f.write_str("none"),
        }
    }
}

/// Differences of natural logarithms below this count as scatter of one value.
const SCATTER: f64 = 0.002;

/// Difference of natural logarithms above which two values are not measurements of one value.
const APART: f64 = 0.25;

/// Least ratio of the gaps between nominal values to the gaps within one.
const LEAST_RATIO: f64 = 1.5;

/// Largest relative move of a value to the middle of the values near it.
const MOST: f64 = 0.25;

/// Largest relative move of a value under [`Rule::Clear`], where gaps leave no doubt.
const MOST_CLEAR: f64 = 0.1;

/// Least ratio of the gap next to a cluster of values to the cluster's width, for values that are clearly one value.
const CLEAR_GAP: f64 = 3.0;

/// Largest number of digits of a number in double precision.
const MOST_DIGITS: usize = 17;

/// Measured values with their nominal values, found by [`nominal`].
#[derive(Clone, Debug, PartialEq)]
pub struct Nominal {
    /// Each measured value, ascending, with its nominal value.
    pub moves: Vec<(f64, f64)>,
}

/// Values that are too close together to be separated by a tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Least of the values.
    pub least: f64,
    /// Largest of the values.
    pub largest: f64,
}

/// Finds the nominal values of `values`, none of which is negative, to within the relative `tolerance`.
///
/// # Errors
/// There are values that extend over more than twice the tolerance, without a gap of the tolerance between them.
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

/// Returns the roundest number within the range of `cluster`, ascending, that is at most `tolerance` away from each
/// value.
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
    // Text rounds to decimal digits; a product with a power of ten would leave round-off, such as 0.6000000000000001.
    let rounded = |digits: usize| format!("{mean:.digits$e}").parse().unwrap_or(mean);
    Ok((0..MOST_DIGITS)
        .map(rounded)
        .into_iter()
        .find(|value| (low..=high).contains(value))
        .unwrap_or(mean))
}

/// Finds the grid to which measured speeds and forces, in pairs, belong; `None` if there is none. It is the grid whose
/// values are the most clearly separated, among those of which at least half of the nodes were measured.
///
/// Values are divided at their largest gaps. The clarity of a division is the ratio of its smallest gap to the largest
/// gap that remains within a cluster.
pub fn grid_by_gaps(places: &[(f64, f64)]) -> Option<(Nominal, Nominal)> {
    let (speeds, forces): (Vec<f64>, Vec<f64>) = places.iter().copied().unzip();
    let (speeds, forces) = (cuts(&speeds), cuts(&forces));
    pairs(&speeds, &forces)
        .filter(|((_, speed), (_, force))| density(places, speed, force) >= DENSE)
        .max_by(|a, b| (a.0.0 * a.1.0).total_cmp(&(b.0.0 * b.1.0)))
        .map(|(speed, force)| (speed.1.clone(), force.1.clone()))
}

/// Least fraction of a grid's nodes that were measured.
const DENSE: f64 = 0.5;

/// Returns all pairs of an element of `a` and an element of `b`.
fn pairs<'a, T>(a: &'a [T], b: &'a [T]) -> impl Iterator<Item = (&'a T, &'a T)> {
    a.iter().flat_map(move |a| b.iter().map(move |b| (a, b)))
}

/// Returns the fraction of the nodes in the grid of these nominal values that were measured, at `places`.
fn density(places: &[(f64, f64)], speeds: &Nominal, forces: &Nominal) -> f64 {
    let moved = (places.iter()).map(|&(v, f)| (speeds.of(v).to_bits(), forces.of(f).to_bits()));
    let measured = moved.collect::<HashSet<_>>().len();
    measured as f64 / (speeds.values().len() * forces.values().len()) as f64
}

/// Finds the grid to which measured speeds and forces, in pairs, clearly belong. Values that become one value must
/// extend over less than a third of the gap next to them, and over at most a fifth of their mean. Returns `None` if
/// there is no such grid, or if at least half of the nodes of the unchanged values were measured, because then nothing
/// needs correction.
///
/// If the values on an axis occur twice on average, they are nominal, and stay the same. Of several grids, the one with
/// the largest fraction of measured nodes is taken, and then the finest.
pub fn clear_grid(places: &[(f64, f64)]) -> Option<(Nominal, Nominal)> {
    let (speeds, forces): (Vec<f64>, Vec<f64>) = places.iter().copied().unzip();
    let (speeds, forces) = (clear_cuts(&speeds), clear_cuts(&forces));
    // The first entry is always that of the unchanged values.
    if density(places, &speeds[0], &forces[0]) >= DENSE {
        return None;
    }
    let found = pairs(&speeds, &forces).map(|(speed, force)| {
        let nodes = speed.values().len() * force.values().len();
        (density(places, speed, force), nodes, (speed, force))
    });
    let best = found.max_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (_, _, (speed, force)) = best.filter(|(density, ..)| *density >= DENSE)?;
    Some((speed.clone(), force.clone()))
}

/// Returns the ways to merge neighbouring `values` that are clear from their gaps, beginning with the unchanged values.
fn clear_cuts(values: &[f64]) -> Vec<Nominal> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let as_they_are = Nominal {
        moves: sorted.iter().map(|&value| (value, value)).collect(),
    };
    if 2 * sorted.len() <= values.len() {
        return vec![as_they_are];
    }
    let gaps = log_gaps(&sorted);
    let cut = |count: usize| {
        let clusters = clusters(&sorted, &gaps, count);
        let width = |cluster: &[f64]| cluster[cluster.len() - 1] - cluster[0];
        let mut before = 0.0;
        for (index, cluster) in clusters.iter().enumerate() {
            let next = clusters.get(index + 1).map_or(f64::INFINITY, |next| next[0]);
            let last = cluster[cluster.len() - 1];
            let gap = (cluster[0] - before).min(next - last);
            // Written as a product, because a single value may be zero.
            let is_clear = CLEAR_GAP * width(cluster) < gap || cluster.len() == 1;
            if !is_clear || width(cluster) > MOST_CLEAR * (cluster[0] + last) {
                return None;
            }
            before = last;
        }
        Nominal::of_clusters(&clusters)
    };
    // A grid cannot have more values.
    let merged = (0..gaps.len().min(MAX_AXIS_LEN)).rev().filter_map(cut);
    std::iter::once(as_they_are).chain(merged).collect()
}

/// Returns the difference of the natural logarithms of two neighbouring values. Zero means rest or no contact, and is
/// far from every other value.
fn log_gap(before: f64, after: f64) -> f64 {
    if before > 0.0 { (after / before).ln() } else { f64::MAX }
}

/// Returns the gaps between `sorted` values, the largest first.
fn log_gaps(sorted: &[f64]) -> Vec<f64> {
    let mut gaps: Vec<f64> = sorted.windows(2).map(|pair| log_gap(pair[0], pair[1])).collect();
    gaps.sort_by(|a, b| b.total_cmp(a));
    gaps
}

/// Divides `sorted` values at the `count` largest of their `gaps`.
fn clusters<'a>(sorted: &'a [f64], gaps: &[f64], count: usize) -> Vec<&'a [f64]> {
    let least = count.checked_sub(1).map_or(f64::INFINITY, |last| gaps[last]);
    sorted.chunk_by(|a, b| log_gap(*a, *b) < least).collect()
}

/// Returns the ways to merge neighbouring `values` by divisions at the largest gaps, each with its clarity.
fn cuts(values: &[f64]) -> Vec<(f64, Nominal)> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let gaps = log_gaps(&sorted);
    let cut = |count: usize| {
        // A single cluster has no gap, so it is compared with the least distance of two values.
        let between = count.checked_sub(1).map_or(APART, |last| gaps[last]);
        let within = gaps.get(count).copied().unwrap_or(0.0);
        let clear = between / within.max(SCATTER);
        if clear < LEAST_RATIO {
            return None;
        }
        Some((clear, Nominal::of_clusters(&clusters(&sorted, &gaps, count))?))
    };
    (0..=gaps.len()).filter_map(cut).collect()
}

impl Nominal {
    /// Moves the values of each of `clusters`, which are ascending, to one value; `None` if a cluster is too wide.
    fn of_clusters(clusters: &[&[f64]]) -> Option<Self> {
        let mut moves = Vec::new();
        for cluster in clusters {
            let (least, largest) = (cluster[0], cluster[cluster.len() - 1]);
            let half = (largest - least) / (largest + least).max(f64::MIN_POSITIVE);
            if half > MOST {
                return None;
            }
            let to = centre(cluster, (1.5 * half).max(0.02)).ok()?;
            moves.extend(cluster.iter().map(|&from| (from, to)));
        }
        Some(Self { moves })
    }

    /// Returns the nominal value of `value`, one of the measured values.
    pub fn of(&self, value: f64) -> f64 {
        let index = self.moves.partition_point(|&(from, _)| from < value);
        self.moves.get(index).map_or(value, |&(_, to)| to)
    }

    /// Returns the nominal values, ascending.
    pub fn values(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.moves.iter().map(|&(_, to)| to).collect();
        values.dedup();
        values
    }

    /// Returns the largest move, as a fraction of the nominal value.
    pub fn largest_move(&self) -> f64 {
        self.moves
            .iter()
            .filter(|(_, to)| *to > 0.0)
            .map(|(from, to)| (from - to).abs() / to)
            .fold(0.0, f64::max)
    }

    /// Returns the moves in words; `None` if nothing was moved.
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
    /// in which something was moved. With a rule based on gaps, a texture whose values do not belong to a grid stays
    /// the same.
    pub fn snapped(mut self, snap: Snap) -> Result<(Self, Vec<String>)> {
        let groups: Vec<(String, Vec<usize>)> = self
            .by_texture()
            .into_iter()
            .map(|(name, members)| (name.to_owned(), members))
            .collect();
        let mut lines = Vec::new();
        for (name, members) in groups {
            let places: Vec<(f64, f64)> = (members.iter().map(|&member| &self.trials[member]))
                .map(|trial| (trial.speed_mm_s, trial.force_n))
                .collect();
            let found = match snap {
                Snap::Within(tolerance) => Some(within(&name, &places, tolerance)?),
                Snap::By(Rule::Clear) => clear_grid(&places),
                Snap::By(Rule::Auto) => grid_by_gaps(&places),
                Snap::By(Rule::None) => None,
            };
            let Some((speeds, forces)) = found else {
                continue;
            };
            for &member in &members {
                let trial = &mut self.trials[member];
                // Spectral lines stay at the speed that was measured.
                trial.measured_speed_mm_s.get_or_insert(trial.speed_mm_s);
                trial.speed_mm_s = speeds.of(trial.speed_mm_s);
                trial.force_n = forces.of(trial.force_n);
            }
            let words: Vec<String> = [speeds.in_words("speeds", "mm/s"), forces.in_words("forces", "N")]
                .into_iter()
                .flatten()
                .collect();
            if !words.is_empty() {
                lines.push(format!("texture '{name}': {}", words.join("; ")));
            }
        }
        Ok((self, lines))
    }
}

/// Returns the nominal speeds and forces of the `places` of texture `name`, to within `tolerance`.
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
    Ok((found("speeds", "mm/s", speeds)?, found("forces", "N", forces)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    #[test]
    fn measured_values_become_the_round_ones_that_they_are_near() {
        let measured = [98.7, 101.2, 100.4, 49.1, 50.6, 0.0, 203.0];
        let found = nominal(&measured, 0.04).unwrap();
        assert_eq!(found.values(), [0.0, 50.0, 100.0, 203.0]);
        assert_eq!(found.of(98.7), 100.0);
        assert!((found.largest_move() - 0.018).abs() < 1e-9, "49.1 to 50");
        // A smaller tolerance moves less, and nothing if it separates all values.
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

    /// Pairs of a grid whose values are each measured to within the relative deviation `share`.
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
            near(found / meant, 1.0, 0.06);
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
            .map(|n| (20.0 + 5.0 * f64::from(n * 11 % 30), 0.3 + 0.1 * f64::from(n * 7 % 30)))
            .collect();
        assert!(grid_by_gaps(&anywhere).is_none());
    }

    /// Size of the grid to which `places` clearly belong.
    fn clear_size(places: &[(f64, f64)]) -> Option<(usize, usize)> {
        clear_grid(places).map(|(speeds, forces)| (speeds.values().len(), forces.values().len()))
    }

    #[test]
    fn only_a_sparse_grid_of_measured_values_with_clear_gaps_is_mended_unasked() {
        let speeds = [25.0, 50.0, 100.0, 200.0];
        let places = measured(&speeds, &[0.5, 1.0, 2.0], 0.05);
        assert_eq!(clear_size(&places), Some((4, 3)));
        // Values that were typed stay the same, however close together they are.
        let typed = measured(&[50.0, 100.0, 105.0, 150.0], &[0.5, 1.0, 2.0], 0.0);
        assert_eq!(clear_size(&typed), None);
        let forces = measured(&[50.0, 100.0, 105.0, 150.0], &[0.5, 1.0, 2.0], 0.03);
        let of_typed: Vec<_> = typed.iter().zip(&forces).map(|(typed, off)| (typed.0, off.1)).collect();
        assert_eq!(clear_size(&of_typed), Some((4, 3)));
        let near = measured(&[50.0, 100.0, 105.0, 150.0], &[0.5, 1.0, 2.0], 0.002);
        assert_eq!(clear_size(&near), Some((4, 3)));
        // Gaps of less than three widths, pairs on a line, and pairs that belong to no grid.
        assert_eq!(
            clear_size(&measured(&[80.0, 100.0, 125.0], &[0.5, 1.0, 2.0], 0.09)),
            None
        );
        assert_eq!(clear_size(&measured(&speeds, &[1.0], 0.0)), None);
        let anywhere: Vec<_> = (1..30).map(|n| (f64::from(n), f64::from(n * 7 % 30))).collect();
        assert_eq!(clear_size(&anywhere), None);
    }

    proptest! {
        #[test]
        fn what_is_clearly_one_value_is_narrower_than_a_third_of_the_gap_beside_it(
            places in prop::collection::vec((1.0..100.0f64, 0.1..2.0f64), 1..24),
        ) {
            let Some((speeds, forces)) = clear_grid(&places) else { return Ok(()) };
            for found in [speeds, forces] {
                let ends: Vec<(f64, f64)> = (found.moves.chunk_by(|a, b| a.1 == b.1))
                    .map(|one| (one[0].0, one[one.len() - 1].0))
                    .collect();
                for pair in ends.windows(2) {
                    let gap = pair[1].0 - pair[0].1;
                    let widest = (pair[0].1 - pair[0].0).max(pair[1].1 - pair[1].0);
                    prop_assert!(3.0 * widest < gap, "{:?}", pair);
                }
            }
        }

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
            // Values that are already nominal stay the same.
            let again = nominal(&found.values(), tolerance);
            if let Ok(again) = again {
                prop_assert!(again.values().len() <= found.values().len());
            }
        }
    }
}
