//! Speed and position of the tool, from the encoder's counts of each block.
//!
//! A count is a step of the path, and the tool is somewhere within it. Each tick adds the count that it reads, so a
//! block of ten ticks has a mean position that is much finer than a count: it knows at which tick a count came. A
//! filter of position, velocity and acceleration with fading memory follows these means, once per update. Its gains are
//! those of the polynomial of degree 2 with weights that fall by θ per update (Morrison, *Introduction to Sequential
//! Smoothing and Prediction*, 1969): θ is 0.87, a memory of 15 ms, and 0.6 when the prediction misses by two counts,
//! because a hand that turns would otherwise outrun it.
//!
//! **Two bounds hold it to what was counted.** The position is never outside of the present count, so that a surface is
//! the same forwards and backwards. The speed is within a count of the mean of the last two blocks, 4 ms, so that a
//! hand that stops or changes its speed at once is followed within 6 ms. After [`REST_BLOCKS`] blocks without a count
//! the tool is at rest, exactly. **Its price** is that of every filter that looks ahead: a change by some mm/s that
//! takes less than its memory is shown larger for a moment, as is a tremor.
//!
//! Noise and delay of the estimate, beside those of a mean of 20 ms: `host-tools/COSTS.md`, "Speed of the hand".
//!
//! The position felt is off by at most 5 µm RMS and by a count at 20 to 300 mm/s, so that the phase noise of a line of
//! 0.6 mm is at most 3° RMS. `firmware/app/tests/app/speed.rs` and `lines.rs` hold these figures.

use super::{InputConfig, Sensors, Timed};
use crate::UPDATE_INTERVAL_TICKS;

/// Blocks without a count after which the tool is at rest: 20 ms, as long as a count takes at 0.5 mm/s.
pub const REST_BLOCKS: u32 = 10;

/// Age of a block's mean at the block's last tick, blocks.
const MEAN_AGE: f32 = (UPDATE_INTERVAL_TICKS - 1) as f32 / 2.0 / UPDATE_INTERVAL_TICKS as f32;

/// Middle of a count. Both of its ends are the same in both directions, so the tool is there on the average.
const MIDDLE: f32 = 0.5;

/// Most by which the velocity of a tool may differ from the mean of two blocks' counts, counts per block.
const RESOLUTION: f32 = 0.5;

/// Gains of position, velocity and acceleration.
#[derive(Clone, Copy)]
struct Gains([f32; 3]);

/// Gains of a steady hand.
const STEADY: Gains = Gains::of_memory(0.87);

/// Gains of a hand that turns.
const TURNING: Gains = Gains::of_memory(0.6);

/// Difference of prediction and encoder at which the gains begin to grow, counts. Up to half a count is resolution.
const STEADY_COUNTS: f32 = 0.6;

/// Difference from which on they are those of a hand that turns.
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
    /// Velocity there, counts per block.
    velocity: f32,
    /// Acceleration, counts per block and block.
    acceleration: f32,
    /// Counts of the last block, and of the one before.
    moved: [f32; 2],
    /// Number of blocks since the last count.
    resting: u32,
    /// Number of blocks that the sensors had ended, and the encoder's count then.
    blocks: u32,
    counts: i32,
}

impl Estimator {
    /// A tool at rest, of which nothing has been read.
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

    /// Motion at the last tick of the block that `sensors` ended last, and the tick of its last good conversion.
    pub fn motion(&mut self, sensors: &Sensors, config: &InputConfig) -> Timed {
        self.follow(sensors);
        sensors.moving_at(config.speed(self.velocity()), config)
    }

    /// Count of the encoder at the end of the last block, modulo 2³².
    pub fn counts(&self) -> i32 {
        self.counts
    }

    /// Position at the last tick, from the beginning of the present count to its end: 0 to 1.
    pub(super) fn within_count(&self) -> f32 {
        let ahead = (self.velocity + self.acceleration * (MEAN_AGE / 2.0)) * MEAN_AGE;
        (self.position + ahead).clamp(0.0, 1.0)
    }

    /// Velocity and acceleration at the last tick, counts per block (and block).
    pub(super) fn course(&self) -> [f32; 2] {
        let velocity = self.velocity + self.acceleration * MEAN_AGE;
        [velocity, self.acceleration]
    }

    /// Velocity at the last tick, within the resolution of what was counted, counts per block.
    fn velocity(&self) -> f32 {
        let mean = f32::midpoint(self.moved[0], self.moved[1]);
        let [velocity, _] = self.course();
        velocity.clamp(mean - RESOLUTION, mean + RESOLUTION)
    }

    /// Updates the estimate with the block that `sensors` ended last, unless it has that block already. Blocks that a
    /// late update has left out are bridged.
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
        let mean = sensors.last.sum as f32 / UPDATE_INTERVAL_TICKS as f32;
        let measured = mean - sensors.last.counts as f32 + MIDDLE;
        if self.resting.max(passed) >= REST_BLOCKS {
            self.position = measured;
            self.velocity = self.moved[0];
            self.acceleration = 0.0;
            self.moved[1] = self.moved[0];
            return;
        }
        let predicted = self.position - counts
            + (self.velocity + self.acceleration * (elapsed / 2.0)) * elapsed;
        self.velocity += self.acceleration * elapsed;
        let miss = measured - predicted;
        let Gains([position, velocity, acceleration]) = Gains::of_miss(miss.abs());
        self.position = predicted + position * miss;
        self.velocity += velocity * miss;
        self.acceleration += acceleration * miss;
    }
}
