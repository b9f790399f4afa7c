//! Stretches of a free hand's recording in which the tool moves on the surface in one direction.
//!
//! Motion is judged in blocks of 20 ms. A block ends a stretch if within it the direction changes, a value is one that
//! no hand and no sensor can produce, or the speed jumps by more than a hand can cause (such as when an encoder loses a
//! count). Stretches also end where the direction changes between blocks.

use std::ops::Range;

use stylus_dsp::sums::upper_median;

use super::read::Freehand;

/// Speed below which a hand counts as resting, mm/s.
pub const LEAST_SPEED_MM_S: f64 = 5.0;

/// Force below which a tool counts as being in the air, N.
pub const LEAST_FORCE_N: f64 = 0.05;

/// Length of a block, s, before it is rounded to whole samples.
const BLOCK_S: f64 = 0.02;

/// Bounds of a jump of the speed from one sample to the next: in mm/s, as a fraction of the block's median speed, and
/// as a multiple of its median step. A change that exceeds all three is not a motion. A hand accelerates by at most 50
/// m/s², which is 10 mm/s in 0.2 ms.
const JUMP_MM_S: f64 = 50.0;
const JUMP_SHARE: f64 = 0.5;
const JUMP_STEPS: f64 = 8.0;

/// Largest fraction of a block's samples that may have the other direction.
const MINORITY: f64 = 0.1;

/// Motion in a block of [`BLOCK_S`].
#[derive(Clone, Copy, Debug, PartialEq)]
enum Block {
    /// Mean speed, mm/s, and mean force, N, of a motion in one direction.
    Motion {
        speed_mm_s: f64,
        force_n: f64,
        is_backward: bool,
    },
    /// The block contains a value that no hand and no sensor can produce.
    Outlier,
    /// The block contains motion in both directions.
    Reversal,
    /// The block contains a jump of the speed.
    Jump,
}

fn block_length(recording: &Freehand) -> usize {
    ((BLOCK_S * recording.rate_hz).round() as usize).max(1)
}

/// Returns the duration of a block, which is a whole number of samples, in s.
fn block_s(recording: &Freehand) -> f64 {
    block_length(recording) as f64 / recording.rate_hz
}

/// Returns the times, s, at which the blocks begin in which the speed jumps.
pub fn jumps_s(recording: &Freehand) -> Vec<f64> {
    blocks(recording)
        .into_iter()
        .enumerate()
        .filter(|(_, block)| *block == Block::Jump)
        .map(|(block, _)| block as f64 * block_s(recording))
        .collect()
}

/// Returns the stretches of `recording`, each at least `least_s` long, in which the tool moves in contact and in one
/// direction, without outliers or jumps in speed.
pub fn moving(recording: &Freehand, least_s: f64) -> Vec<Range<usize>> {
    let (length, block_s) = (block_length(recording), block_s(recording));
    let direction = |block: &Block| match *block {
        Block::Motion {
            speed_mm_s,
            force_n,
            is_backward,
        } if speed_mm_s >= LEAST_SPEED_MM_S && force_n >= LEAST_FORCE_N => Some(is_backward),
        _ => None,
    };
    let blocks = blocks(recording);
    let directions: Vec<Option<bool>> = blocks.iter().map(direction).collect();
    let mut end = 0;
    directions
        .chunk_by(|a, b| a == b)
        .filter_map(|run| {
            let first = end;
            end += run.len();
            (run[0].is_some() && run.len() as f64 * block_s >= least_s).then_some(first * length..end * length)
        })
        .collect()
}

/// Returns the motion of each whole block. A change of direction of a hand at rest does not count as a reversal.
fn blocks(recording: &Freehand) -> Vec<Block> {
    let length = block_length(recording);
    let count = recording.speed_mm_s.len() / length;
    (0..count)
        .map(|block| block_of(recording, block * length..(block + 1) * length))
        .collect()
}

fn block_of(recording: &Freehand, range: Range<usize>) -> Block {
    if recording.is_outlier[range.clone()].contains(&true) {
        return Block::Outlier;
    }
    let speeds = &recording.speed_mm_s[range.clone()];
    let backward = &recording.is_backward[range.clone()];
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let share = backward.iter().filter(|backward| **backward).count() as f64 / speeds.len() as f64;
    let is_moving = mean(speeds) >= LEAST_SPEED_MM_S;
    if is_moving && share > MINORITY && share < 1.0 - MINORITY {
        return Block::Reversal;
    }
    let signed = |n: usize| if backward[n] { -speeds[n] } else { speeds[n] };
    let steps: Vec<f64> = (1..speeds.len()).map(|n| (signed(n) - signed(n - 1)).abs()).collect();
    let largest = steps.iter().copied().fold(0.0, f64::max);
    if largest > JUMP_MM_S.max(JUMP_SHARE * median(speeds)) && largest > JUMP_STEPS * median(&steps) {
        return Block::Jump;
    }
    Block::Motion {
        speed_mm_s: mean(speeds),
        force_n: mean(&recording.force_n[range]),
        is_backward: share > 0.5,
    }
}

/// Returns the median; 0 if there are no values, such as the steps of a block of one sample.
fn median(values: &[f64]) -> f64 {
    upper_median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recording that holds each (speed, force) for the given number of seconds.
    fn recording(parts: &[(f64, f64, f64)]) -> Freehand {
        let mut speed_mm_s = Vec::new();
        let mut force_n = Vec::new();
        for &(speed, force, seconds) in parts {
            let samples = (seconds * 1000.0) as usize;
            speed_mm_s.extend(vec![speed; samples]);
            force_n.extend(vec![force; samples]);
        }
        Freehand {
            rate_hz: 1000.0,
            axes: vec![vec![0.1; speed_mm_s.len()]],
            is_outlier: vec![false; speed_mm_s.len()],
            is_backward: vec![false; speed_mm_s.len()],
            speed_mm_s,
            force_n,
            outlier: None,
            is_simulated: false,
            is_unscaled: false,
            remarks: Vec::new(),
        }
    }

    #[test]
    fn stretches_in_motion_end_at_rest_in_the_air_at_outliers_and_where_the_hand_turns() {
        let mut hand = recording(&[
            (100.0, 0.6, 1.0),
            (0.0, 0.6, 0.5),
            (30.0, 1.0, 0.5),
            (30.0, 0.0, 0.2),
            (30.0, 1.0, 0.08),
            (3.0, 1.0, 0.2),
        ]);
        assert_eq!(moving(&hand, 0.1), [0..1000, 1500..2000]);
        hand.is_outlier[310] = true;
        hand.is_backward[600..].fill(true);
        assert_eq!(moving(&hand, 0.1), [0..300, 320..600, 600..1000, 1500..2000]);
    }

    #[test]
    fn a_jump_of_the_speed_ends_a_stretch_and_is_told_and_a_fast_hand_does_not() {
        let mut hand = recording(&[(100.0, 0.6, 2.0)]);
        hand.speed_mm_s[1010] = 400.0;
        assert_eq!(moving(&hand, 0.1), [0..1000, 1020..2000]);
        assert_eq!(jumps_s(&hand), [1.0]);
        hand.speed_mm_s = (0..2000).map(|n| 6.0 + f64::from(n) * 0.15).collect();
        assert_eq!(moving(&hand, 0.1).len(), 1);
        assert!(jumps_s(&hand).is_empty());
    }

    /// At 1024 Hz, a block has 20 samples, which are 19.5 ms.
    #[test]
    fn times_are_those_of_the_samples_where_a_block_is_no_whole_number_of_them() {
        let mut hand = recording(&[(100.0, 0.6, 8.192)]);
        hand.rate_hz = 1024.0;
        hand.speed_mm_s[4010] = 400.0;
        assert_eq!(jumps_s(&hand), [4000.0 / 1024.0]);
        hand.force_n[200..].fill(0.0);
        // The first 200 samples take 0.1953 s.
        assert_eq!(moving(&hand, 0.195).len(), 1);
        assert_eq!(moving(&hand, 0.196).len(), 0);
    }
}
