//! Segmentation of a free hand's recording into parts of nearly steady motion.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Serialize;

use super::grid::{GridAxis, LEAST_FORCE_N, LEAST_SPEED_MM_S, proposed_grid};
use super::read::Freehand;
use crate::dsp::sums::upper_median;
use crate::support::error::{Error, Result};
use crate::support::number::counted;

/// Length of a block, s, before it is rounded to whole samples.
const BLOCK_S: f64 = 0.02;

/// Largest deviation of a quantity from the middle of its range within a segment. The larger of the two bounds applies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Bound as a fraction of the middle.
    pub share: f64,
    /// Bound in the quantity's unit.
    pub least: f64,
}

impl Tolerance {
    fn holds(self, low: f64, high: f64) -> bool {
        0.5 * (high - low) <= self.least.max(self.share * 0.5 * (high + low))
    }
}

/// Bounds of a jump of the speed from one sample to the next: in mm/s, as a fraction of the block's median speed, and
/// as a multiple of its median step. A change that exceeds all three is not a motion. A hand accelerates by at most 50
/// m/s², which is 10 mm/s in 0.2 ms.
const JUMP_MM_S: f64 = 50.0;
const JUMP_SHARE: f64 = 0.5;
const JUMP_STEPS: f64 = 8.0;

/// Largest fraction of a block's samples that may have the other direction.
const MINORITY: f64 = 0.1;

/// Options of a segmentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Tolerance of the speed, mm/s.
    pub speed: Tolerance,
    /// Tolerance of the force, N.
    pub force: Tolerance,
    /// Shortest segment, s.
    pub least_s: f64,
    /// Least total duration of a node's segments, s.
    pub enough_s: f64,
    /// Speeds of the grid, mm/s.
    pub speeds: GridAxis,
    /// Forces of the grid, N.
    pub forces: GridAxis,
}

/// A part of a recording in which the motion is nearly steady.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Segment {
    /// Index of the recording that contains the segment.
    pub recording: usize,
    /// Index of the first sample in the recording.
    pub first: usize,
    /// Index after the last sample.
    pub end: usize,
    /// Median speed, mm/s.
    pub median_speed_mm_s: f64,
    /// Median force, N.
    pub median_force_n: f64,
}

/// A segment with the node to which it belongs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Placed {
    /// The segment.
    pub segment: Segment,
    /// The node's speed, mm/s.
    pub speed_mm_s: f64,
    /// The node's force, N.
    pub force_n: f64,
}

/// Result of a segmentation.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// The segments that can be used, in the order of their nodes.
    pub placed: Vec<Placed>,
    /// Segments in motion and contact that are not within half a step of any node.
    pub off_grid: Vec<Segment>,
    /// Nodes with too little data: speed, mm/s, force, N, and total duration of the node's segments, s.
    pub too_little: Vec<(f64, f64, f64)>,
    /// Number of changes of direction, at which segments end.
    pub reversals: usize,
    /// Blocks in which the speed jumps: index of the recording, and time at which the block starts, s.
    pub jumps: Vec<(usize, f64)>,
    /// Fraction of the time in motion and contact that is within segments.
    pub steady_share: f64,
}

/// Largest number of segments off the grid that are reported individually.
const NAMED: usize = 10;

/// Steady fraction of the motion below which a note states that little is steady.
const LITTLE: f64 = 0.5;

impl Options {
    /// Returns the options for these recordings: the axes of the grid that are given, or else proposed, and the
    /// relative tolerance.
    ///
    /// # Errors
    /// There is no motion in contact, so that no grid can be proposed.
    pub fn of(
        recordings: &[Freehand],
        (speeds, forces): (Option<GridAxis>, Option<GridAxis>),
        tolerance: f64,
        (least_s, enough_s): (f64, f64),
    ) -> Result<Self> {
        let (speeds, forces) = match (speeds, forces, proposed_grid(recordings)) {
            (Some(speeds), Some(forces), _) => (speeds, forces),
            (speeds, forces, Some(proposed)) => (speeds.unwrap_or(proposed.0), forces.unwrap_or(proposed.1)),
            (.., None) => {
                return Err(Error::Request(
                    "no motion in contact, so that no grid can be proposed and no piece is steady; check the columns \
                     speed_mm_s and force_n, or give speeds and forces of the grid"
                        .into(),
                ));
            }
        };
        // At the lowest speeds and forces a relative tolerance is too strict. There, deviations of up to a quarter of
        // the grid's step count as steady.
        let tolerance = |axis: &GridAxis| Tolerance {
            share: tolerance,
            least: 0.25 * axis.step,
        };
        Ok(Self {
            speed: tolerance(&speeds),
            force: tolerance(&forces),
            least_s,
            enough_s,
            speeds,
            forces,
        })
    }
}

impl Segmentation {
    /// Checks that there is a segment.
    pub fn check(&self) -> Result<()> {
        if self.placed.is_empty() {
            return Err(Error::Request(
                "no piece is steady for long enough on this grid; record longer strokes, or give a wider tolerance, a \
                 shorter least duration of a piece or of a node's pieces, or another grid"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Returns notes on what is left out, one line each.
    pub fn left_out(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.reversals > 0 {
            notes.push(format!(
                "the speed changes its sign {}; pieces end there, and both directions count alike",
                counted(self.reversals, "time")
            ));
        }
        if let Some((recording, time_s)) = self.jumps.first() {
            notes.push(format!(
                "the speed jumps in {} of 20 ms, first at {time_s:.2} s of recording {}; cut out (check the \
                 encoder)",
                counted(self.jumps.len(), "block"),
                recording + 1
            ));
        }
        notes.extend(
            self.too_little.iter().map(|(speed, force, seconds)| {
                format!("{speed} mm/s, {force} N: only {seconds:.2} s of data; left out")
            }),
        );
        notes.extend(self.off_grid.iter().take(NAMED).map(|segment| {
            format!(
                "a steady piece at {:.1} mm/s, {:.2} N is off the grid; left out",
                segment.median_speed_mm_s, segment.median_force_n
            )
        }));
        if self.off_grid.len() > NAMED {
            notes.push(format!("{} pieces in total are off the grid", self.off_grid.len()));
        }
        if self.steady_share < LITTLE && !self.placed.is_empty() {
            notes.push(
                "more than half of the motion is left out: a wider tolerance keeps more, and evaluate --strokes tells \
                 which comes nearer"
                    .into(),
            );
        }
        notes
    }
}

/// Cuts `recordings` into segments and assigns them to the nodes of the grid.
pub fn segment(recordings: &[Freehand], options: &Options) -> Segmentation {
    let (mut steady, mut moving) = (0.0, 0.0);
    let mut nodes: BTreeMap<(u64, u64), Vec<Placed>> = BTreeMap::new();
    let mut off_grid = Vec::new();
    let mut seconds = BTreeMap::new();
    let (mut reversals, mut jumps) = (0, Vec::new());
    for (index, recording) in recordings.iter().enumerate() {
        moving += moving_s(recording, options);
        let blocks = blocks(recording, 0.5 * options.speeds.lowest);
        reversals += count_reversals(&blocks, options);
        jumps.extend(jump_times_s(&blocks, block_s(recording)).map(|time_s| (index, time_s)));
        for segment in segments_of(recording, &blocks, index, options) {
            let length_s = (segment.end - segment.first) as f64 / recording.rate_hz;
            // A hand at rest or in the air is steady, too.
            if !is_moving(segment.median_speed_mm_s, segment.median_force_n, options) {
                continue;
            }
            steady += length_s;
            let speed = options.speeds.nearest(segment.median_speed_mm_s);
            let force = options.forces.nearest(segment.median_force_n);
            let (Some(speed_mm_s), Some(force_n)) = (speed, force) else {
                off_grid.push(segment);
                continue;
            };
            // The bits of positive numbers are ordered like the numbers.
            let node = (speed_mm_s.to_bits(), force_n.to_bits());
            *seconds.entry(node).or_insert(0.0) += length_s;
            nodes.entry(node).or_default().push(Placed {
                segment,
                speed_mm_s,
                force_n,
            });
        }
    }
    let scarce = |node: &(u64, u64)| seconds[node] < options.enough_s;
    let too_little = nodes
        .keys()
        .filter(|node| scarce(node))
        .map(|node| (f64::from_bits(node.0), f64::from_bits(node.1), seconds[node]))
        .collect();
    let enough = nodes.into_iter().filter(|(node, _)| !scarce(node));
    Segmentation {
        placed: enough.flat_map(|(_, placed)| placed).collect(),
        off_grid,
        too_little,
        reversals,
        jumps,
        // Segments consist of whole blocks, which may have samples at rest.
        steady_share: if moving > 0.0 { (steady / moving).min(1.0) } else { 0.0 },
    }
}

/// Returns true if the tool moves on the surface: speed and force are at least half of the grid's lowest values.
fn is_moving(speed_mm_s: f64, force_n: f64, options: &Options) -> bool {
    speed_mm_s >= 0.5 * options.speeds.lowest && force_n >= 0.5 * options.forces.lowest
}

/// Returns the time in motion and contact, in s.
fn moving_s(recording: &Freehand, options: &Options) -> f64 {
    let pairs = recording.speed_mm_s.iter().zip(&recording.force_n);
    let count = pairs
        .filter(|(speed, force)| is_moving(**speed, **force, options))
        .count();
    count as f64 / recording.rate_hz
}

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

/// Returns the times, s, at which the `blocks`, each `block_s` long, begin in which the speed jumps.
fn jump_times_s(blocks: &[Block], block_s: f64) -> impl Iterator<Item = f64> {
    let starts = blocks.iter().enumerate().filter(|(_, block)| **block == Block::Jump);
    starts.map(move |(block, _)| block as f64 * block_s)
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
    let blocks = blocks(recording, LEAST_SPEED_MM_S);
    let directions: Vec<Option<bool>> = blocks.iter().map(direction).collect();
    let mut end = 0;
    let runs = directions.chunk_by(|a, b| a == b).map(|run| {
        let first = end;
        end += run.len();
        (run[0].is_some() && run.len() as f64 * block_s >= least_s).then_some(first * length..end * length)
    });
    runs.flatten().collect()
}

/// Returns the motion of each whole block. A change of direction at less than `rest_mm_s` does not count as a reversal.
fn blocks(recording: &Freehand, rest_mm_s: f64) -> Vec<Block> {
    let length = block_length(recording);
    let count = recording.speed_mm_s.len() / length;
    (0..count)
        .map(|block| block_of(recording, block * length..(block + 1) * length, rest_mm_s))
        .collect()
}

fn block_of(recording: &Freehand, range: Range<usize>, rest_mm_s: f64) -> Block {
    if recording.is_outlier[range.clone()].contains(&true) {
        return Block::Outlier;
    }
    let speeds = &recording.speed_mm_s[range.clone()];
    let backward = &recording.is_backward[range.clone()];
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let share = backward.iter().filter(|backward| **backward).count() as f64 / speeds.len() as f64;
    let is_moving = mean(speeds) >= rest_mm_s;
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

/// Returns the number of changes of direction between blocks in motion.
fn count_reversals(blocks: &[Block], options: &Options) -> usize {
    let moving = blocks.iter().filter_map(|block| match block {
        Block::Motion {
            speed_mm_s,
            is_backward,
            ..
        } if *speed_mm_s >= 0.5 * options.speeds.lowest => Some(*is_backward),
        _ => None,
    });
    let directions: Vec<bool> = moving.collect();
    directions.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Returns the segments of one recording.
fn segments_of(recording: &Freehand, blocks: &[Block], index: usize, options: &Options) -> Vec<Segment> {
    let length = block_length(recording);
    let least = (options.least_s / block_s(recording)).ceil().max(1.0) as usize;
    let mut segments = Vec::new();
    let mut begin = 0;
    while begin < blocks.len() {
        let end = steady_end(blocks, begin, options);
        // A steady part may begin at any block.
        if end - begin < least {
            begin += 1;
            continue;
        }
        let (first, end_sample) = (begin * length, end * length);
        segments.push(Segment {
            recording: index,
            first,
            end: end_sample,
            median_speed_mm_s: median(&recording.speed_mm_s[first..end_sample]),
            median_force_n: median(&recording.force_n[first..end_sample]),
        });
        begin = end;
    }
    segments
}

/// Returns the index of the first block after the segment that starts at block `begin`.
fn steady_end(blocks: &[Block], begin: usize, options: &Options) -> usize {
    let (mut speeds, mut forces) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
    let mut direction = None;
    for (index, block) in blocks.iter().enumerate().skip(begin) {
        let &Block::Motion {
            speed_mm_s,
            force_n,
            is_backward,
        } = block
        else {
            return index;
        };
        speeds = (speeds.0.min(speed_mm_s), speeds.1.max(speed_mm_s));
        forces = (forces.0.min(force_n), forces.1.max(force_n));
        if *direction.get_or_insert(is_backward) != is_backward
            || !options.speed.holds(speeds.0, speeds.1)
            || !options.force.holds(forces.0, forces.1)
        {
            return index;
        }
    }
    blocks.len()
}

/// Returns the median; 0 if there are no values, such as the steps of a block of one sample.
fn median(values: &[f64]) -> f64 {
    upper_median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: Options = Options {
        speed: Tolerance { share: 0.1, least: 4.0 },
        force: Tolerance {
            share: 0.1,
            least: 0.05,
        },
        least_s: 0.2,
        enough_s: 0.5,
        speeds: GridAxis {
            lowest: 20.0,
            highest: 300.0,
            step: 20.0,
        },
        forces: GridAxis {
            lowest: 0.2,
            highest: 1.4,
            step: 0.2,
        },
    };

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
            outliers: Vec::new(),
            is_simulated: false,
            remarks: Vec::new(),
        }
    }

    #[test]
    fn steady_parts_become_pieces_at_their_medians_nodes() {
        let hand = recording(&[(103.0, 0.63, 1.0), (0.0, 0.0, 0.5), (216.0, 1.18, 0.8)]);
        let cut = segment(&[hand], &OPTIONS);
        let nodes = cut.placed.iter().map(|p| (p.speed_mm_s, p.force_n));
        let nodes: Vec<_> = nodes.collect();
        assert_eq!(nodes, [(100.0, 0.6), (220.0, 1.2)]);
        assert_eq!(cut.placed[0].segment.median_force_n, 0.63);
        assert!(cut.steady_share > 0.99);
        assert!(cut.off_grid.is_empty() && cut.too_little.is_empty());
    }

    #[test]
    fn a_ramp_is_cut_into_pieces_that_keep_the_tolerance() {
        let mut hand = recording(&[(100.0, 0.6, 4.0)]);
        for (n, speed) in hand.speed_mm_s.iter_mut().enumerate() {
            *speed = 60.0 + 0.04 * n as f64;
        }
        let cut = segment(std::slice::from_ref(&hand), &OPTIONS);
        assert!(cut.placed.len() > 3);
        for placed in &cut.placed {
            let part = &hand.speed_mm_s[placed.segment.first..placed.segment.end];
            let middle = f64::midpoint(part[0], part[part.len() - 1]);
            assert!(part[part.len() - 1] - middle <= 0.1 * middle + 1.0);
        }
    }

    #[test]
    fn nothing_goes_across_an_outlier() {
        let mut hand = recording(&[(100.0, 0.6, 2.0)]);
        hand.is_outlier[1010] = true;
        let cut = segment(&[hand], &OPTIONS);
        let ends = cut.placed.iter().map(|p| (p.segment.first, p.segment.end));
        let ends: Vec<_> = ends.collect();
        assert_eq!(ends, [(0, 1000), (1020, 2000)]);
    }

    #[test]
    fn what_is_too_little_or_off_the_grid_is_said() {
        let hand = recording(&[(100.0, 0.6, 0.3), (600.0, 0.6, 1.0), (200.0, 0.6, 1.0)]);
        let cut = segment(&[hand], &OPTIONS);
        assert_eq!(cut.placed.len(), 1);
        assert_eq!(cut.off_grid.len(), 1);
        assert_eq!((cut.too_little[0].0, cut.too_little[0].1), (100.0, 0.6));
        assert!((cut.too_little[0].2 - 0.3).abs() < 1e-9);
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

    fn ends(cut: &Segmentation) -> Vec<(usize, usize)> {
        cut.placed.iter().map(|p| (p.segment.first, p.segment.end)).collect()
    }

    #[test]
    fn segments_end_where_the_direction_changes_and_it_is_counted() {
        let mut hand = recording(&[(100.0, 0.6, 2.0)]);
        hand.is_backward[1000..].fill(true);
        let cut = segment(&[hand], &OPTIONS);
        assert_eq!(ends(&cut), [(0, 1000), (1000, 2000)]);
        assert_eq!(cut.reversals, 1);
    }

    #[test]
    fn a_jump_of_the_speed_breaks_a_segment_and_a_fast_hand_does_not() {
        let mut hand = recording(&[(100.0, 0.6, 2.0)]);
        hand.speed_mm_s[1010] = 400.0;
        let cut = segment(std::slice::from_ref(&hand), &OPTIONS);
        assert_eq!(ends(&cut), [(0, 1000), (1020, 2000)]);
        assert_eq!(cut.jumps, [(0, 1.0)]);
        hand.speed_mm_s = (0..2000).map(|n| f64::from(n) * 0.15).collect();
        assert!(segment(&[hand], &OPTIONS).jumps.is_empty());
    }

    /// At 1024 Hz, a block has 20 samples, which are 19.5 ms.
    #[test]
    fn times_are_those_of_the_samples_where_a_block_is_no_whole_number_of_them() {
        let mut hand = recording(&[(100.0, 0.6, 8.192)]);
        hand.rate_hz = 1024.0;
        hand.speed_mm_s[4010] = 400.0;
        let cut = segment(std::slice::from_ref(&hand), &OPTIONS);
        assert_eq!(cut.jumps, [(0, 4000.0 / 1024.0)]);
        hand.force_n[200..].fill(0.0);
        let enough = |least_s| {
            let options = Options {
                least_s,
                enough_s: 0.0,
                ..OPTIONS
            };
            let cut = segment(std::slice::from_ref(&hand), &options);
            (cut.placed.len(), moving(&hand, least_s).len())
        };
        // The first 200 samples take 0.1953 s.
        assert_eq!(enough(0.195), (1, 1));
        assert_eq!(enough(0.196), (0, 0));
    }
}
