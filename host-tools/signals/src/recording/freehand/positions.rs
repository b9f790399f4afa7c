//! The tangential speed from positions, as motion trackers and encoders write them.
//!
//! A tracker is slower than the accelerometer, so its positions are held for many samples, and their differences are
//! zeros and spikes. The speed is therefore the slope of a straight line that is fitted to the positions around each
//! sample.

use stylus_support::csv_table::Header;
use stylus_support::number::MAX_SPEED_MM_S;

/// Length of the fit without held positions, s: about the 20 ms over which the stylus means its own speed.
const WINDOW_S: f64 = 0.025;

/// Number of distinct positions in a window. With noise of σ in each at 240 Hz, the slope errs by 0.06 σ per
/// millisecond: 1.1 mm/s for σ = 0.02 mm.
const UPDATES: usize = 6;

/// Longest window, s. Positions that are held for longer do not show a stroke.
const LONGEST_WINDOW_S: f64 = 0.25;

/// Words that a position's name may have in addition to its axis.
const WORDS: [&str; 7] = ["pos", "position", "tip", "tool", "pen", "stylus", "probe"];

/// A column of positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PositionColumn {
    pub index: usize,
    /// Length of a unit, mm.
    pub unit_mm: f64,
}

/// Returns the columns of positions: `position_mm` along a path, or up to three such as `x_mm` or `Pos Y (m)`.
pub(super) fn columns(header: &Header<'_>) -> Vec<PositionColumn> {
    let (axes, along): (Vec<_>, Vec<_>) = header
        .names()
        .enumerate()
        .filter_map(|(index, name)| Some((index, position(name)?)))
        .partition(|(_, (has_axis, _))| *has_axis);
    let chosen = if axes.is_empty() { along } else { axes };
    let column = |(index, (_, unit_mm))| PositionColumn { index, unit_mm };
    chosen.into_iter().map(column).collect()
}

/// Returns whether the name of a position has an axis, and the length of its unit, mm; `None` for other names.
fn position(name: &str) -> Option<(bool, f64)> {
    let lower = name.to_lowercase();
    let mut words: Vec<&str> = lower
        .split(|sign: char| !sign.is_alphanumeric())
        .filter(|word| !word.is_empty())
        .collect();
    let unit_mm = match words.pop()? {
        "um" | "µm" => 1e-3,
        "mm" => 1.0,
        "cm" => 10.0,
        "m" => 1000.0,
        _ => return None,
    };
    let (axes, others): (Vec<&str>, Vec<&str>) = words.iter().partition(|word| ["x", "y", "z"].contains(word));
    let is_known = others.iter().all(|word| WORDS.contains(word));
    let is_position = axes.len() == 1 || (axes.is_empty() && others.contains(&"position"));
    (is_known && is_position).then_some((axes.len() == 1, unit_mm))
}

/// Returns the tangential speed, mm/s, at each sample of `positions_mm`, which has one to three axes of equal length.
/// On one axis, its sign is the direction; on several, it is a magnitude. Where a fit contains a jump that no hand can
/// perform, such as that of a tracker that loses its mark, it is the speed of the jump.
pub(super) fn speed_mm_s(positions_mm: &[Vec<f64>], rate_hz: f64) -> Vec<f64> {
    let held = held_samples(positions_mm);
    let longest = (LONGEST_WINDOW_S * rate_hz) as usize;
    let window = ((WINDOW_S * rate_hz).round() as usize).max(UPDATES * held);
    let half = window.min(longest).div_ceil(2).max(1);
    let slopes: Vec<Vec<f64>> = (positions_mm.iter()).map(|axis| slopes(axis, half, rate_hz)).collect();
    let mut speeds = match slopes.as_slice() {
        [along] => along.clone(),
        axes => norms(axes),
    };
    for n in 1..speeds.len() {
        let step_mm = positions_mm
            .iter()
            .map(|axis| axis[n] - axis[n - 1])
            .map(|step| step * step)
            .sum::<f64>()
            .sqrt();
        let jump_mm_s = step_mm * rate_hz / held as f64;
        if jump_mm_s > MAX_SPEED_MM_S {
            let end = (n + half + 1).min(speeds.len());
            speeds[n.saturating_sub(half + 1)..end].fill(jump_mm_s);
        }
    }
    speeds
}

fn norms(axes: &[Vec<f64>]) -> Vec<f64> {
    let length = axes.first().map_or(0, Vec::len);
    let norm = |n: usize| axes.iter().map(|axis| axis[n].powi(2)).sum::<f64>().sqrt();
    (0..length).map(norm).collect()
}

/// Returns for how many samples a position is usually held: the median over all that are left again.
fn held_samples(positions_mm: &[Vec<f64>]) -> usize {
    let length = positions_mm.first().map_or(0, Vec::len);
    let is_new = |n: &usize| positions_mm.iter().any(|axis| axis[*n] != axis[n - 1]);
    let changes: Vec<usize> = (1..length).filter(is_new).collect();
    let mut held: Vec<usize> = changes.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = held.len() / 2;
    if held.is_empty() {
        return 1;
    }
    *held.select_nth_unstable(middle).1
}

/// Returns the slope, per second, of the line through the samples within `half` of each sample, by least squares. At
/// the ends, it is that of the samples that exist.
fn slopes(axis: &[f64], half: usize, rate_hz: f64) -> Vec<f64> {
    // Sums of x and of n x up to each sample. About the first sample, so that they stay small.
    let first = axis.first().copied().unwrap_or_default();
    let mut sums = vec![(0.0, 0.0)];
    for (n, x) in axis.iter().enumerate() {
        let (sum, moment) = sums[n];
        sums.push((sum + (x - first), moment + n as f64 * (x - first)));
    }
    (0..axis.len())
        .map(|n| {
            let (begin, end) = (n.saturating_sub(half), (n + half + 1).min(axis.len()));
            let (sum, moment) = (sums[end].0 - sums[begin].0, sums[end].1 - sums[begin].1);
            let count = (end - begin) as f64;
            let middle = (begin + end - 1) as f64 / 2.0;
            let spread = count * (count * count - 1.0) / 12.0;
            if spread > 0.0 {
                (moment - middle * sum) / spread * rate_hz
            } else {
                0.0
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use stylus_dsp::sums::rms;
    use test_helpers::noise;

    #[test]
    fn positions_are_known_by_their_names_and_units() {
        for (name, expected) in [
            ("x_mm", Some((true, 1.0))),
            ("Pos Y (m)", Some((true, 1000.0))),
            ("tip position z [cm]", Some((true, 10.0))),
            ("position_mm", Some((false, 1.0))),
            ("x", None),
            ("ax_mm", None),
            ("x (N)", None),
            ("distance_mm", None),
            ("mm", None),
        ] {
            assert_eq!(position(name), expected, "{name}");
        }
    }

    /// A hand's strokes, 40 mm to and fro at 0.7 Hz and 15 mm across, at 10 kHz.
    fn stroke(n: usize) -> [f64; 2] {
        let turns = 0.7 * n as f64 / 10_000.0;
        [40.0 * (TAU * turns).sin(), 15.0 * (TAU * 0.5 * turns).sin()]
    }

    #[test]
    fn speeds_of_a_slow_noisy_tracker_are_those_of_the_hand() {
        let length = 60_000;
        // At 240 Hz, each position is held for about 42 samples.
        let count = length / 42 + 1;
        let off = [1, 2].map(|seed| noise(seed, count));
        let updates: Vec<[f64; 2]> = (0..count)
            .map(|update| {
                let [x, y] = stroke(42 * update);
                [x + 0.02 * off[0][update], y + 0.02 * off[1][update]]
            })
            .collect();
        let axes = [0, 1].map(|axis| (0..length).map(|n| updates[n / 42][axis]).collect());
        let speeds = speed_mm_s(&axes, 10_000.0);
        let errors = (1000..length - 1000).map(|n| {
            // Held positions are half an update late.
            let [before, after] = [n - 22, n - 20].map(stroke);
            let truth = ((after[0] - before[0]).hypot(after[1] - before[1])) * 5000.0;
            speeds[n] - truth
        });
        let errors: Vec<f64> = errors.collect();
        let rms = rms(&errors);
        // 176 mm/s at most. The bound is twice the derived 1.1 mm/s per axis.
        assert!(rms < 2.3, "{rms}");
    }

    #[test]
    fn along_one_axis_the_sign_is_the_direction() {
        let there: Vec<f64> = (0..2000).map(|n| 0.1 * f64::from(n)).collect();
        let back = there.iter().rev().copied().collect();
        for (axis, expected) in [(there, 500.0), (back, -500.0)] {
            let speeds = speed_mm_s(&[axis], 5000.0);
            assert!(speeds.iter().all(|speed| (speed - expected).abs() < 1e-6));
        }
    }
}
