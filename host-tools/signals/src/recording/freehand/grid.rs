//! The grid to which segments are assigned: given, or proposed from the recordings.

use super::read::Freehand;

/// Speed below which a hand counts as resting, mm/s.
pub const LEAST_SPEED_MM_S: f64 = 5.0;

/// Force below which a tool counts as being in the air, N.
pub const LEAST_FORCE_N: f64 = 0.05;

/// Largest number of lines per axis of a proposed grid: the paper's 15 speeds, and slightly more than its 8 forces.
const SPEEDS: f64 = 15.0;
const FORCES: f64 = 10.0;

/// Fraction of the samples in motion and contact that a proposed grid leaves out at each end.
const LEFT_OUT: f64 = 0.02;

/// Axis of a grid with evenly spaced values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridAxis {
    /// Lowest value, above zero.
    pub lowest: f64,
    /// Highest value.
    pub highest: f64,
    /// Step from one value to the next.
    pub step: f64,
}

impl GridAxis {
    /// Returns the grid's value nearest to `value`, if it is within half a step.
    pub(super) fn nearest(&self, value: f64) -> Option<f64> {
        // Round-off must not take away the highest value.
        let last = ((self.highest - self.lowest) / self.step + 1e-9).floor();
        let index = ((value - self.lowest) / self.step).round().clamp(0.0, last);
        let nearest = self.lowest + index * self.step;
        // Rounded to the decimals that a user writes: 0.6, not 0.6000000000000001.
        let nearest = (nearest * 1e6).round() / 1e6;
        ((value - nearest).abs() <= 0.5 * self.step * (1.0 + 1e-9)).then_some(nearest)
    }
}

impl std::fmt::Display for GridAxis {
    /// Writes the axis in the form in which it is parsed: `20:300:20`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", self.lowest, self.highest, self.step)
    }
}

impl std::str::FromStr for GridAxis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(':').map(|word| word.parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[lowest, highest, step])
                if lowest > 0.0 && highest >= lowest && step > 0.0 && highest.is_finite() =>
            {
                Ok(Self { lowest, highest, step })
            }
            _ => Err("must be LOWEST:HIGHEST:STEP, all above zero, such as 20:300:20".into()),
        }
    }
}

/// Returns the speeds and forces of a grid that covers nearly all of the motion in contact in `recordings`; `None` if
/// there is no such motion.
///
/// Steps are 1, 2 or 5 times a power of ten, and lines are multiples of the step, because such values are easy to name.
pub fn proposed_grid(recordings: &[Freehand]) -> Option<(GridAxis, GridAxis)> {
    let (mut speeds, mut forces) = (Vec::new(), Vec::new());
    for recording in recordings {
        let samples = recording.speed_mm_s.iter().zip(&recording.force_n);
        for ((&speed, &force), is_outlier) in samples.zip(&recording.is_outlier) {
            if speed >= LEAST_SPEED_MM_S && force >= LEAST_FORCE_N && !is_outlier {
                speeds.push(speed);
                forces.push(force);
            }
        }
    }
    Some((proposed(speeds, SPEEDS)?, proposed(forces, FORCES)?))
}

/// Returns an axis of at most `lines` lines for `values` above zero; `None` if there are none.
fn proposed(mut values: Vec<f64>, lines: f64) -> Option<GridAxis> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let margin = (LEFT_OUT * last as f64) as usize;
    let (low, high) = (values[margin], values[last - margin]);
    // Lines begin one step above zero at the earliest, so the highest value decides the step.
    let exact = high / lines;
    let power = 10f64.powf(exact.log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        // Round-off must not lead to the next larger step.
        .find(|factor| factor * power >= exact * (1.0 - 1e-9))?;
    // Powers of ten below one are not exact, so values are rounded to the decimals that a user would write.
    let rounded = |value: f64| (value * 1e6).round() / 1e6;
    let step = rounded(factor * power);
    Some(GridAxis {
        // A line at zero would be a node at rest or without contact.
        lowest: rounded((low / step).round().max(1.0) * step),
        highest: rounded((high / step).round().max(1.0) * step),
        step,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_read_as_they_are_written() {
        let axis: GridAxis = "0.2:1.4:0.2".parse().unwrap();
        assert_eq!(axis.nearest(0.58), Some(0.6));
        assert_eq!(axis.nearest(1.51), None);
        assert_eq!(axis.nearest(0.05), None);
        for bad in ["", "1:2", "0:3:1", "3:2:1", "1:2:0", "a:b:c"] {
            assert!(bad.parse::<GridAxis>().is_err(), "{bad}");
        }
    }

    fn hand(speeds: std::ops::Range<f64>, forces: std::ops::Range<f64>) -> Freehand {
        let between = |range: &std::ops::Range<f64>, n: usize| {
            range.start + (range.end - range.start) * (n % 1000) as f64 / 1000.0
        };
        let speed_mm_s: Vec<f64> = (0..5000).map(|n| between(&speeds, n)).collect();
        Freehand {
            rate_hz: 1000.0,
            axes: vec![vec![0.1; 5000]],
            is_outlier: vec![false; 5000],
            is_backward: vec![false; 5000],
            force_n: (0..5000).map(|n| between(&forces, n)).collect(),
            speed_mm_s,
            outliers: Vec::new(),
            is_simulated: false,
            remarks: Vec::new(),
        }
    }

    #[test]
    fn a_proposed_grid_reaches_as_far_as_the_hand_did() {
        let (speeds, forces) = proposed_grid(&[hand(12.0..290.0, 0.3..4.3)]).unwrap();
        assert_eq!((speeds.lowest, speeds.highest, speeds.step), (20.0, 280.0, 20.0));
        assert_eq!((forces.lowest, forces.highest, forces.step), (0.5, 4.0, 0.5));
        for force in [0.4, 4.2] {
            assert!(forces.nearest(force).is_some(), "{force}");
        }
        assert_eq!(proposed_grid(&[hand(0.0..1.0, 0.0..2.0)]), None);
    }
}
