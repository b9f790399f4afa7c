//! Speed and position of the tool, from the encoder's counts of each block.
//!
//! A count is one step of the path, and the tool is somewhere within it. Each tick reads the counter, so the mean
//! position over a block of ten ticks is much finer than a count: it depends on the tick at which each count came. A
//! fading-memory filter of position, velocity and acceleration follows these means, once per update. Its gains are
//! those of a polynomial of degree 2 that is fitted with weights falling by the factor θ per update (Morrison,
//! *Introduction to Sequential Smoothing and Prediction*, 1969). θ is 0.87, which is a memory of 15 ms. Where the
//! prediction misses by two counts, θ is 0.6, because a hand that reverses would otherwise outrun the filter.
//!
//! **Two bounds tie the estimate to the counts.** The position never leaves the present count, so that a surface feels
//! the same forwards and backwards. The speed differs from the mean of the last two blocks, 4 ms, by at most one count
//! in these 4 ms, so that the estimate follows a hand that stops or changes its speed abruptly within 6 ms. After
//! [`REST_BLOCKS`] blocks without a count the tool is exactly at rest. **The price** is that of every filter that
//! predicts: a change of speed by some mm/s that is shorter than the memory is overestimated for a moment, and so is a
//! tremor.
//!
//! `host-tools/manual/COSTS.md`, "Speed of the hand", compares noise and delay of the estimate with those of a mean of
//! 20 ms.
//!
//! The position that is felt is wrong by at most 5 µm RMS, and by at most one count, at 20 to 300 mm/s. The phase noise
//! of a line with a period of 0.6 mm is therefore at most 3° RMS. `firmware/app/tests/app/speed.rs` and `lines.rs` hold
//! these figures.

use super::{InputConfig, Sensors, Timed};
use crate::UPDATE_INTERVAL_TICKS;

/// Blocks without a count after which the tool is at rest: 20 ms, as long as a count takes at 0.5 mm/s.
pub const REST_BLOCKS: u32 = 10;

/// Age of a block's mean at the block's last tick: the time since the middle of the block, blocks.
const MEAN_AGE: f32 = (UPDATE_INTERVAL_TICKS - 1) as f32 / 2.0 / UPDATE_INTERVAL_TICKS as f32;

/// Middle of a count, where the tool is on average. The ends of a count lie at the same places in both directions.
const MIDDLE: f32 = 0.5;

/// Largest difference of the velocity from the mean of the last two blocks' counts, counts per block.
const RESOLUTION: f32 = 0.5;

/// Gains of position, velocity and acceleration.
#[derive(Clone, Copy)]
struct Gains([f32; 3]);

/// Gains for a hand at steady speed.
const STEADY: Gains = Gains::of_memory(0.87);

/// Gains for a hand that reverses.
const TURNING: Gains = Gains::of_memory(0.6);

/// Difference between prediction and encoder above which the gains begin to grow, counts. Up to half a count is the
/// encoder's resolution.
const STEADY_COUNTS: f32 = 0.6;

/// Difference between prediction and encoder from which on the gains are [`TURNING`], counts.
const TURNING_COUNTS: f32 = 2.1;

impl Gains {
    const fn of_memory(theta: f32) -> Self {
        let rest = 1.0 - theta;
        Self([
            1.0 - theta * theta * theta,
            1.5 * rest * rest * (1.0 + theta),
            rest * rest * rest,
        ])
    }

    /// The gains for a prediction that misses by `counts`.
    fn of_miss(counts: f32) -> Self {
        let share = (counts - STEADY_COUNTS) / (TURNING_COUNTS - STEADY_COUNTS);
        let share = share.clamp(0.0, 1.0);
        let mut gains = STEADY.0;
        for (gain, turning) in gains.iter_mut().zip(TURNING.0) {
            *gain += share * (turning - *gain);
        }
        Self(gains)
    }
}

/// Estimate of the tool's motion along the encoder's path.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimator {
    /// Position at the middle of the last block, counts from the beginning of the present count.
    position: f32,
    /// Velocity at the middle of the last block, counts per block.
    velocity: f32,
    /// Acceleration, counts per block².
    acceleration: f32,
    /// Counts of the last block, and of the block before it.
    moved: [f32; 2],
    /// Number of blocks since the last count.
    resting: u32,
    /// Number of blocks that had ended at the last update, and the encoder's count at that time.
    blocks: u32,
    counts: i32,
}

impl Estimator {
    /// The estimate of a tool at rest, before anything has been read.
    pub const fn new() -> Self {
        Self {
            position: MIDDLE,
            velocity: 0.0,
            acceleration: 0.0,
            moved: [0.0; 2],
            resting: 0,
            blocks: 0,
            counts: 0,
        }
    }

    /// Returns the motion at the last tick of the last whole block of `sensors`, with the tick of the force's last good
    /// conversion.
    pub fn motion(&mut self, sensors: &Sensors, config: &InputConfig) -> Timed {
        self.follow(sensors);
        sensors.moving_at(config.speed(self.velocity()), config)
    }

    /// Count of the encoder at the end of the last block, modulo 2³².
    pub fn counts(&self) -> i32 {
        self.counts
    }

    /// Position at the last tick within the present count, from 0 at its beginning to 1 at its end.
    pub(super) fn within_count(&self) -> f32 {
        let ahead = (self.velocity + self.acceleration * (MEAN_AGE / 2.0)) * MEAN_AGE;
        (self.position + ahead).clamp(0.0, 1.0)
    }

    /// Velocity at the last tick, counts per block, and acceleration, counts per block².
    pub(super) fn course(&self) -> [f32; 2] {
        let velocity = self.velocity + self.acceleration * MEAN_AGE;
        [velocity, self.acceleration]
    }

    /// Velocity at the last tick, held within [`RESOLUTION`] of the counts, counts per block.
    fn velocity(&self) -> f32 {
        let mean = f32::midpoint(self.moved[0], self.moved[1]);
        let [velocity, _] = self.course();
        velocity.clamp(mean - RESOLUTION, mean + RESOLUTION)
    }

    /// Updates the estimate with the last whole block of `sensors`, once per block. If a late update has skipped
    /// blocks, the prediction spans them.
    fn follow(&mut self, sensors: &Sensors) {
        let passed = sensors.ended.wrapping_sub(self.blocks);
        if passed == 0 {
            return;
        }
        let counts = sensors.counts.wrapping_sub(self.counts) as f32;
        (self.blocks, self.counts) = (sensors.ended, sensors.counts);
        let elapsed = passed as f32;
        self.moved = [counts / elapsed, self.moved[0]];
        self.resting = if counts == 0.0 {
            self.resting.saturating_add(passed)
        } else {
            0
        };
        // The sum counts from the block's beginning. From the beginning of the present count the mean lies back by the
        // counts that the block has added.
        let mean = sensors.last.sum as f32 / UPDATE_INTERVAL_TICKS as f32;
        let measured = mean - sensors.last.counts as f32 + MIDDLE;
        // Exactly at rest, which the filter would only approach.
        if self.resting.max(passed) >= REST_BLOCKS {
            self.position = measured;
            self.velocity = self.moved[0];
            self.acceleration = 0.0;
            self.moved[1] = self.moved[0];
            return;
        }
        // Without the new counts, because the position is relative to the present count.
        let predicted = self.position - counts + (self.velocity + self.acceleration * (elapsed / 2.0)) * elapsed;
        self.velocity += self.acceleration * elapsed;
        let miss = measured - predicted;
        let Gains([position, velocity, acceleration]) = Gains::of_miss(miss.abs());
        self.position = predicted + position * miss;
        self.velocity += velocity * miss;
        self.acceleration += acceleration * miss;
    }
}
