//! Samples that left the range at one end and came back at the other: an integer that overflowed.

use super::axis::Axis;

/// Least jump, as a share of the range.
const JUMP: f64 = 0.7;

/// Largest share of the range that all but one in 200 steps of a recording stay below.
const ORDINARY_STEP: f64 = 0.5;

/// Fewest jumps that count.
const LEAST_JUMPS: usize = 2;

/// Returns the times of the jumps, s; none if steps of such size are ordinary, as in white noise.
pub(super) fn overflows(axis: &Axis<'_>, rate_hz: f64) -> Vec<f64> {
    let (low, high, largest_step) = (axis.low, axis.high, axis.largest_step);
    let axis = axis.samples;
    let range = high - low;
    if range <= 0.0 {
        return Vec::new();
    }
    let at_ends = |pair: &[f64]| {
        let (lower, upper) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
        lower < low + 0.15 * range && upper > high - 0.15 * range
    };
    let steps = || axis.windows(2).enumerate();
    let size = |pair: &[f64]| (pair[1] - pair[0]).abs() / range;
    let is_jump = |pair: &[f64]| size(pair) >= JUMP && at_ends(pair);
    // Few recordings have any large step, and the others are done with here.
    if largest_step < ORDINARY_STEP * range {
        return Vec::new();
    }
    let large = steps().filter(|(_, pair)| size(pair) >= ORDINARY_STEP && !is_jump(pair));
    let ordinary = large.count() * 200 <= axis.len();
    let jumps = steps().filter(|(_, pair)| is_jump(pair));
    let times: Vec<f64> = jumps
        .map(|(index, _)| (index + 1) as f64 / rate_hz)
        .collect();
    if ordinary && times.len() >= LEAST_JUMPS {
        times
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_that_comes_back_at_the_other_end_is_found() {
        let wave = |n: i32| 0.9 * (0.01 * f64::from(n)).sin() + 0.15 * (0.3 * f64::from(n)).sin();
        let clean: Vec<f64> = (0..5000).map(wave).collect();
        assert!(overflows(&Axis::of(&clean), 5000.0).is_empty());
        let wrapped: Vec<f64> = clean.iter().map(|x| x - 2.0 * (0.5 * x).round()).collect();
        assert!(overflows(&Axis::of(&wrapped), 5000.0).len() >= LEAST_JUMPS);
    }
}
