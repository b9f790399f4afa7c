//! Regions of a grid whose residuals differ: rectangles of nodes, found by repeated division where a test finds that
//! the two sides differ.

use std::ops::Range;

use super::evidence::{KURTOSIS_SAMPLES, Sums, gaussian_kurtosis};
use super::trace::Trace;

/// Number of standard deviations by which two sides must differ: a probability of 1e-4 per division. At most 1 in 100
/// uniform grids of any size is then divided.
const DEVIATIONS: f64 = 3.9;

/// Least number of trials on either side of a division. Their scatter is used to judge the sides.
const LEAST_TRIALS: usize = 5;

/// Least ratio of the two sides' kurtosis: half an octave.
const LEAST_RATIO: f64 = 1.41;

/// A rectangle of nodes of the grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Region {
    /// Indices of speeds.
    pub speeds: Range<usize>,
    /// Indices of forces.
    pub forces: Range<usize>,
}

impl Region {
    /// Returns whether a node is in the region.
    pub fn contains(&self, at: (usize, usize)) -> bool {
        self.speeds.contains(&at.0) && self.forces.contains(&at.1)
    }

    /// Returns the pairs of regions into which this one can be divided.
    fn divisions(&self) -> impl Iterator<Item = [Self; 2]> {
        let by_speed = (self.speeds.start + 1..self.speeds.end).map(|at| {
            [self.speeds.start..at, at..self.speeds.end].map(|speeds| Self {
                speeds,
                forces: self.forces.clone(),
            })
        });
        let by_force = (self.forces.start + 1..self.forces.end).map(|at| {
            [self.forces.start..at, at..self.forces.end].map(|forces| Self {
                speeds: self.speeds.clone(),
                forces,
            })
        });
        by_speed.chain(by_force)
    }
}

/// Divides a grid of `shape` (numbers of speeds and forces) into at most `most` regions, at the clearest difference
/// first. Returns one region if nothing differs.
pub(super) fn regions(traces: &[Trace], shape: (usize, usize), most: usize) -> Vec<Region> {
    let mut regions = vec![Region {
        speeds: 0..shape.0,
        forces: 0..shape.1,
    }];
    while regions.len() < most {
        let divisions = regions.iter().enumerate().flat_map(|(index, region)| {
            region
                .divisions()
                .map(move |sides| (index, difference(traces, &sides), sides))
        });
        let clearest = divisions.max_by(|a, b| a.1.total_cmp(&b.1));
        match clearest {
            Some((index, deviations, sides)) if deviations > DEVIATIONS => {
                regions.splice(index..=index, sides);
            }
            _ => break,
        }
    }
    regions
}

/// Divides a grid of `forces` forces into `count` regions of speeds, which have the same ratio of highest to lowest
/// speed. Regions that hold none of the ascending `speeds_mm_s` are left out.
pub(super) fn by_speed(speeds_mm_s: &[f32], forces: usize, count: usize) -> Vec<Region> {
    let lowest = speeds_mm_s.iter().copied().find(|&speed| speed > 0.0);
    let octaves = |speed: f32| (speed / lowest.unwrap_or(1.0)).log2().max(0.0);
    let widest = speeds_mm_s.last().copied().map_or(0.0, octaves);
    // If all speeds are equal, the ratio of octaves is not a number, which is converted to zero.
    let part = |speed| (count as f32 * octaves(speed) / widest) as usize;
    let before = |number| speeds_mm_s.partition_point(|&speed| part(speed).min(count - 1) < number);
    let regions = (0..count).map(|number| Region {
        speeds: before(number)..before(number + 1),
        forces: 0..forces,
    });
    regions.filter(|region| !region.speeds.is_empty()).collect()
}

/// Returns the difference of the two sides' log kurtosis in standard deviations, by the scatter of trials or of
/// windows, whichever is larger. It is 0 if the difference is too small to matter, or if there are too few trials.
fn difference(traces: &[Trace], sides: &[Region; 2]) -> f64 {
    let [a, b] = sides.each_ref().map(|side| {
        let own = || traces.iter().filter(|trace| side.contains(trace.at));
        let means: Vec<f64> = own()
            .map(|trace| trace.judged.kurtosis)
            .filter(|windows| windows.count > 0.0)
            .map(|windows| logarithm(&windows))
            .collect();
        let windows = own()
            .map(|trace| trace.judged.kurtosis)
            .fold(Sums::default(), Sums::plus);
        (Sums::of(&means), windows)
    });
    let least = LEAST_TRIALS as f64;
    let distance = (a.0.mean() - b.0.mean()).abs();
    if a.0.count < least || b.0.count < least || distance < LEAST_RATIO.ln() {
        return 0.0;
    }
    let variance = |(trials, windows): &(Sums, Sums)| {
        // Variance of the logarithm from the windows' own scatter. By the delta method, the variance of a logarithm is
        // the relative variance.
        let within = windows.variance_of_mean() / windows.mean().powi(2);
        trials.variance_of_mean().max(within)
    };
    distance / (variance(&a) + variance(&b)).sqrt().max(f64::MIN_POSITIVE)
}

/// Returns the logarithm of a trial's mean local kurtosis, relative to a Gaussian's.
fn logarithm(windows: &Sums) -> f64 {
    (windows.mean() / gaussian_kurtosis(KURTOSIS_SAMPLES))
        .max(f64::MIN_POSITIVE)
        .ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::excitation::evidence::Judged;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Makes a trial at each node. The kurtosis of its windows has the mean `kurtosis` and a scatter of a third of
    /// that.
    fn grid(shape: (usize, usize), seed: u64, kurtosis: impl Fn(usize, usize) -> f64) -> Vec<Trace> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let nodes = (0..shape.0).flat_map(|speed| (0..shape.1).map(move |force| (speed, force)));
        nodes
            .map(|at| {
                let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
                let windows: Vec<f64> = (0..80).map(|_| kurtosis(at.0, at.1) * (1.0 + normal() / 3.0)).collect();
                Trace {
                    at,
                    judged: Judged {
                        kurtosis: Sums::of(&windows),
                        ..Judged::default()
                    },
                    ..Trace::default()
                }
            })
            .collect()
    }

    #[test]
    fn halves_that_differ_are_told_apart_where_they_do() {
        let traces = grid((10, 6), 1, |speed, _| if speed < 4 { 3.0 } else { 7.0 });
        let found = regions(&traces, (10, 6), 4);
        let halves = [0..4, 4..10].map(|speeds| Region { speeds, forces: 0..6 });
        assert_eq!(found, halves);
        let traces = grid((10, 6), 2, |speed, force| match (speed < 4, force < 3) {
            (true, _) => 3.0,
            (false, true) => 6.0,
            (false, false) => 12.0,
        });
        assert_eq!(regions(&traces, (10, 6), 4).len(), 3);
        assert_eq!(regions(&traces, (10, 6), 2).len(), 2);
        assert_eq!(regions(&traces, (10, 6), 1).len(), 1);
    }

    proptest! {
        /// Covers speed 0 and grids with a single speed.
        #[test]
        fn each_speed_is_in_one_region_and_the_ratio_of_its_ends_is_bounded(
            mut speeds in prop::collection::vec(prop_oneof![Just(0.0f32), 1.0f32..1000.0], 1..16),
            count in 1usize..5,
        ) {
            speeds.sort_by(f32::total_cmp);
            let regions = by_speed(&speeds, 3, count);
            prop_assert!(regions.len() <= count && regions.iter().all(|own| own.forces == (0..3)));
            let joined: Vec<usize> = regions.iter().flat_map(|own| own.speeds.clone()).collect();
            prop_assert_eq!(joined, (0..speeds.len()).collect::<Vec<_>>());
            let ratio = |own: &[f32]| {
                let lowest = own.iter().find(|&&speed| speed > 0.0);
                lowest.map_or(1.0, |lowest| own[own.len() - 1] / lowest)
            };
            let most = ratio(&speeds).powf(1.0 / count as f32);
            prop_assert!(regions.iter().all(|own| ratio(&speeds[own.speeds.clone()]) <= 1.001 * most));
        }
    }

    #[test]
    fn grids_that_are_alike_throughout_or_hardly_recorded_stay_whole() {
        for seed in 0..50 {
            assert_eq!(regions(&grid((8, 5), seed, |_, _| 8.0), (8, 5), 4).len(), 1, "{seed}");
        }
        let few = grid((2, 2), 1, |speed, _| if speed == 0 { 3.0 } else { 30.0 });
        assert_eq!(regions(&few, (2, 2), 4).len(), 1);
        assert_eq!(regions(&[], (3, 3), 4).len(), 1);
    }
}
