//! Levels of a grid's nodes from all windows of a free hand's strokes.
//!
//! Between nodes the device plays the mean of their levels in dB with bilinear weights, and below the grid a power
//! proportional to speed and force. So the level of a window is linear in the levels of the four nodes around its
//! motion, and least squares over all windows gives the nodes' levels. The prior is a straight line over the logarithms
//! of speed and force: a node's distance from the line has a small cost, and so has its difference from the distances
//! of its neighbours. Nodes without windows stay on the line.

use nalgebra::{DMatrix, DVector};
use stylus_dsp::motion_law::{LevelAt, MotionLaw};

use crate::texture::grid::Grid;

/// Cost of a difference of 1 dB between the distances from the line of neighbouring nodes that are a factor of e apart
/// in speed or force. The unit is the cost of an error of 1 dB in one window.
///
/// Costs from 0.3 to 3 predict other simulated strokes equally well, within 0.1 dB.
const SMOOTHNESS: f64 = 1.0;

/// Cost of a distance of 1 dB between a node and the line, in the unit of [`SMOOTHNESS`].
const NEARNESS: f64 = 0.2;

/// Largest number of speeds and most forces of a grid. Between 20 and 400 mm/s, a mean in dB is then within 0.2 dB of a
/// power law of 10 dB per decade. More of them predict simulated strokes of 25 s no better, and fewer nodes then have
/// enough windows.
const MOST: (usize, usize) = (6, 4);

/// Least ratio of neighbouring speeds or forces of a grid.
const LEAST_FACTOR: f64 = 1.3;

/// Least mean number of windows per node of a grid. Five windows are 0.5 s, and a node needs 0.4 s to be fitted. A few
/// windows therefore give few nodes, down to one.
const LEAST_WINDOWS: usize = 5;

/// Fraction of the windows that may lie beyond the grid at either end of an axis.
const BEYOND: f64 = 0.02;

/// Axes of a grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axes {
    /// Ascending speeds, mm/s.
    pub speeds_mm_s: Vec<f64>,
    /// Ascending forces, N.
    pub forces_n: Vec<f64>,
}

impl Axes {
    /// Returns a grid that covers nearly all of the `windows`, at least one, in even steps of the logarithms. It has as
    /// many nodes as the windows are sufficient for.
    pub fn of(windows: &[LevelAt]) -> Self {
        let of = |value: fn(&LevelAt) -> f64, most| axis(windows.iter().map(value).collect(), most);
        let (mut speeds, mut forces) = MOST;
        loop {
            let axes = Self {
                speeds_mm_s: of(|at| at.speed_mm_s, speeds),
                forces_n: of(|at| at.force_n, forces),
            };
            // An axis may have fewer values than allowed, if the hand hardly varied.
            (speeds, forces) = (axes.speeds_mm_s.len(), axes.forces_n.len());
            if LEAST_WINDOWS * speeds * forces <= windows.len() || speeds * forces == 1 {
                return axes;
            }
            // The longer axis is shortened first, so that both keep some resolution.
            if speeds >= forces {
                speeds -= 1;
            } else {
                forces -= 1;
            }
        }
    }

    /// Returns the axes of `grid`.
    pub fn of_grid(grid: &Grid) -> Self {
        let of = |axis: &[f32]| axis.iter().map(|line| f64::from(*line)).collect();
        Self {
            speeds_mm_s: of(&grid.speeds_mm_s),
            forces_n: of(&grid.forces_n),
        }
    }

    /// Returns the speed, mm/s, and force, N, of each node, all forces of the first speed first.
    pub fn nodes(&self) -> impl Iterator<Item = (f64, f64)> {
        let forces = &self.forces_n;
        self.speeds_mm_s
            .iter()
            .flat_map(move |&speed| forces.iter().map(move |&force| (speed, force)))
    }

    /// Returns the nodes around a motion and their weights, which add up to one.
    pub fn around(&self, speed_mm_s: f64, force_n: f64) -> [(usize, f64); 4] {
        let (speed, force) = (
            Place::on(&self.speeds_mm_s, speed_mm_s),
            Place::on(&self.forces_n, force_n),
        );
        let node =
            |speed: (usize, f64), force: (usize, f64)| (speed.0 * self.forces_n.len() + force.0, speed.1 * force.1);
        [
            node(speed.below(), force.below()),
            node(speed.below(), force.above()),
            node(speed.above(), force.below()),
            node(speed.above(), force.above()),
        ]
    }

    /// Returns the change of the level below the lowest speed and force, relative to the level at them, dB.
    fn fade_db(&self, speed_mm_s: f64, force_n: f64) -> f64 {
        let share = |axis: &[f64], value: f64| (value / axis[0]).min(1.0);
        // Power, not amplitude, is proportional to both below the grid.
        10.0 * (share(&self.speeds_mm_s, speed_mm_s) * share(&self.forces_n, force_n)).log10()
    }

    /// Returns the quadratic form of the cost: of the nodes' distances from the line, and of the differences between
    /// neighbours' distances.
    fn penalty(&self) -> DMatrix<f64> {
        let (speeds, forces) = (self.speeds_mm_s.len(), self.forces_n.len());
        let mut penalty = DMatrix::from_diagonal_element(speeds * forces, speeds * forces, NEARNESS);
        let mut join = |one: usize, other: usize, factor: f64| {
            // Adds cost · (x_one - x_other)² to the quadratic form.
            let cost = SMOOTHNESS / factor.ln();
            for (a, b, sign) in [
                (one, one, 1.0),
                (other, other, 1.0),
                (one, other, -1.0),
                (other, one, -1.0),
            ] {
                penalty[(a, b)] += sign * cost;
            }
        };
        for speed in 0..speeds {
            for force in 0..forces {
                let node = speed * forces + force;
                if speed + 1 < speeds {
                    join(
                        node,
                        node + forces,
                        self.speeds_mm_s[speed + 1] / self.speeds_mm_s[speed],
                    );
                }
                if force + 1 < forces {
                    join(node, node + 1, self.forces_n[force + 1] / self.forces_n[force]);
                }
            }
        }
        penalty
    }
}

/// Returns at most `most` values of an axis that cover nearly all of `values`, of which there is at least one and all
/// are above zero.
fn axis(mut values: Vec<f64>, most: usize) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let margin = (BEYOND * last as f64) as usize;
    let (low, high) = (values[margin], values[last - margin]);
    let steps = ((high / low).ln() / LEAST_FACTOR.ln()) as usize;
    let steps = steps.min(most - 1);
    let line = |step: usize| low * (high / low).powf(step as f64 / steps.max(1) as f64);
    if steps == 0 {
        // One value stands for the whole range, so it is in the middle of the logarithms.
        return vec![two_digits((low * high).sqrt())];
    }
    (0..=steps).map(|step| two_digits(line(step))).collect()
}

/// Returns `value`, which is above zero, with two digits, as a user would write it.
fn two_digits(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// Position of a value between the values of an axis.
struct Place {
    lines: (usize, usize),
    /// Weight of the upper value.
    share: f64,
}

impl Place {
    fn on(axis: &[f64], value: f64) -> Self {
        let above = axis.partition_point(|line| *line <= value);
        // Beyond the ends, the device plays the outermost values, too.
        if above == 0 || above == axis.len() {
            let line = above.saturating_sub(1);
            return Self {
                lines: (line, line),
                share: 0.0,
            };
        }
        let (low, high) = (axis[above - 1], axis[above]);
        Self {
            lines: (above - 1, above),
            share: (value - low) / (high - low),
        }
    }

    fn below(&self) -> (usize, f64) {
        (self.lines.0, 1.0 - self.share)
    }

    fn above(&self) -> (usize, f64) {
        (self.lines.1, self.share)
    }
}

/// Levels of all nodes of a grid.
#[derive(Clone, Debug)]
pub(super) struct NodeLevels {
    /// The grid.
    pub axes: Axes,
    /// Level of each node, dB.
    pub levels_db: Vec<f64>,
}

impl NodeLevels {
    /// Returns the levels on `axes` that fit those of the `windows`, at least one, best.
    pub fn of(axes: Axes, windows: &[LevelAt]) -> Self {
        let law = MotionLaw::of(windows).expect("there is a window");
        let prior = axes.nodes().map(|(speed, force)| law.level_db(speed, force));
        let mut levels = Self {
            levels_db: prior.collect(),
            axes,
        };
        // The unknowns are the distances from the line, because these have a cost.
        let mut matrix = levels.axes.penalty();
        let mut right = DVector::zeros(levels.levels_db.len());
        for at in windows {
            let off_db = at.level_db - levels.level_db(at.speed_mm_s, at.force_n);
            let around = levels.axes.around(at.speed_mm_s, at.force_n);
            for (node, weight) in around {
                right[node] += at.weight * weight * off_db;
                for (other, with) in around {
                    matrix[(node, other)] += at.weight * weight * with;
                }
            }
        }
        let factor = matrix
            .cholesky()
            .expect("the penalty is positive definite, and so is its sum with squares");
        let off_db = factor.solve(&right);
        (levels.levels_db.iter_mut().zip(&off_db)).for_each(|(level, off)| *level += off);
        levels
    }

    /// Returns the level at a motion above zero, as the device plays it, dB.
    pub fn level_db(&self, speed_mm_s: f64, force_n: f64) -> f64 {
        let around = self.axes.around(speed_mm_s, force_n);
        let mean: f64 = around.iter().map(|(node, weight)| weight * self.levels_db[*node]).sum();
        mean + self.axes.fade_db(speed_mm_s, force_n)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use test_helpers::near;

    fn windows(motions: &[(f64, f64)], level_db: impl Fn(f64, f64) -> f64) -> Vec<LevelAt> {
        let window = |&(speed_mm_s, force_n): &(f64, f64)| LevelAt {
            speed_mm_s,
            force_n,
            level_db: level_db(speed_mm_s, force_n),
            weight: 1.0,
        };
        motions.iter().map(window).collect()
    }

    fn motions() -> impl Strategy<Value = Vec<(f64, f64)>> {
        let motion = (20f64.ln()..400f64.ln(), 0.3f64.ln()..4f64.ln());
        prop::collection::vec(motion.prop_map(|(speed, force)| (speed.exp(), force.exp())), 200..300)
    }

    #[test]
    fn axes_reach_as_far_as_the_hand_in_steps_that_are_no_finer_than_a_factor() {
        let hand: Vec<(f64, f64)> = (0..1000).map(|n| (10.0 + 0.3 * f64::from(n), 1.0)).collect();
        let axes = Axes::of(&windows(&hand, |_, _| 0.0));
        assert_eq!(axes.forces_n, [1.0]);
        assert_eq!(axes.speeds_mm_s.len(), MOST.0);
        assert_eq!((axes.speeds_mm_s[0], axes.speeds_mm_s[MOST.0 - 1]), (16.0, 300.0));
        let few: Vec<(f64, f64)> = hand.iter().copied().step_by(125).collect();
        let few = Axes::of(&windows(&few, |_, _| 0.0));
        assert_eq!(few.nodes().count(), 1);
        let narrow: Vec<(f64, f64)> = (0..100).map(|n| (100.0 + 0.5 * f64::from(n), 1.0)).collect();
        assert_eq!(Axes::of(&windows(&narrow, |_, _| 0.0)).speeds_mm_s, [100.0, 150.0]);
    }

    proptest! {
        #[test]
        fn a_law_that_no_line_holds_is_found_within_half_a_decibel_where_the_hand_was(motions in motions()) {
            // The amplitude saturates with speed and with force.
            let law = |speed: f64, force: f64| {
                20.0 * (speed / (speed + 100.0)).log10() + 15.0 * (force / (force + 1.0)).log10()
            };
            let windows = windows(&motions, law);
            let levels = NodeLevels::of(Axes::of(&windows), &windows);
            let squares: f64 = windows.iter()
                .map(|at| (levels.level_db(at.speed_mm_s, at.force_n) - at.level_db).powi(2))
                .sum();
            prop_assert!((squares / windows.len() as f64).sqrt() < 0.5);
        }

        #[test]
        fn the_order_of_windows_does_not_matter(motions in motions(), seed in 0usize..1000) {
            let of = |windows: &[LevelAt]| NodeLevels::of(Axes::of(windows), windows);
            let mut all = windows(&motions, |speed, force| 0.1 * speed - force);
            let before = of(&all);
            let middle = seed % all.len();
            all.rotate_left(middle);
            let after = of(&all);
            prop_assert_eq!(&before.axes, &after.axes);
            for (a, b) in before.levels_db.iter().zip(&after.levels_db) {
                prop_assert!((a - b).abs() < 1e-6);
            }
        }

        #[test]
        fn weights_add_up_to_one_and_hold_the_motion(speed in 1f64..1000.0, force in 0.01f64..10.0) {
            let axes = Axes { speeds_mm_s: vec![20.0, 50.0, 130.0], forces_n: vec![0.5, 1.0, 4.0] };
            let nodes: Vec<(f64, f64)> = axes.nodes().collect();
            let around = axes.around(speed, force);
            prop_assert!((around.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
            let mean = |of: fn(&(f64, f64)) -> f64| {
                around.iter().map(|(node, weight)| weight * of(&nodes[*node])).sum::<f64>()
            };
            prop_assert!((mean(|node| node.0) - speed.clamp(20.0, 130.0)).abs() < 1e-9);
            prop_assert!((mean(|node| node.1) - force.clamp(0.5, 4.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn where_the_hand_was_not_the_line_is_left() {
        // A power law, and a hand that varied only the speed at one force, and only the force at one speed.
        let along = (0..100).map(|n| 1.0 + f64::from(n) / 20.0);
        let hand: Vec<(f64, f64)> = (along.clone().map(|share| (60.0 * share, 0.5)))
            .chain(along.map(|share| (60.0, 0.5 * share)))
            .collect();
        let law = |speed: f64, force: f64| 12.0 * speed.log10() + 6.0 * force.log10();
        let windows = windows(&hand, law);
        let levels = NodeLevels::of(Axes::of(&windows), &windows);
        let (speed, force) = (
            *levels.axes.speeds_mm_s.last().unwrap(),
            *levels.axes.forces_n.last().unwrap(),
        );
        let corner = levels.levels_db.last().unwrap();
        near(*corner, law(speed, force), 0.5);
    }
}
