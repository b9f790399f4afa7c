//! Speed and position of the tool, from the encoder's counts of each block, and its position when it is felt.
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
//! The [`Tracker`] computes the position when a block's last sample is felt, for lines that are tied to position.
//!
//! The position that is felt is wrong by at most 5 µm RMS, and by at most one count, at 20 to 300 mm/s. The phase noise
//! of a line with a period of 0.6 mm is therefore at most 3° RMS. `firmware/app/tests/app/speed.rs` and `lines.rs` hold
//! these figures.
//!
//! **From the encoder.** The motion of the [`Estimator`] is extrapolated by [`LEAD_TICKS`]. It has no lag at constant
//! speed or constant acceleration. While the hand reverses from 100 mm/s, the position is wrong by less than a count if
//! the reversal takes 0.9 s, and for a moment by up to three counts if it takes 0.3 s, because jerk cannot be
//! predicted (`firmware/app/tests/app/lines.rs`). At the edge of a count, where the counter flickers, the error
//! doubles.
//!
//! **From the host.** The host's positions arrive at up to 1 kHz, and up to a millisecond late or early. The position
//! continues at the speed that the host sent last, and each update that has a new motion corrects a fifth of its
//! difference from the host's position. If the host sends no positions, the position is the integral of the signed
//! speed.

use stylus_kernel::position::Position;

use super::{InputConfig, Sensors, Timed};
use crate::{SAMPLE_RATE_HZ, UPDATE_INTERVAL_TICKS, UPDATE_LEAD_TICKS};

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

/// Ticks from the reading of the inputs until the hand feels the last sample of the block computed from them.
///
/// The block begins [`UPDATE_LEAD_TICKS`] after the reading, and its last sample follows 9 ticks later. The codes of
/// that sample begin 1.1 ticks after it, and the interpolation filter delays them by 1.7 ticks. At 10 kHz the last
/// sample comes half a tick later, but the filter delays it by 0.7 ticks only, so it is felt half a tick earlier. That
/// is 10 µm at 100 mm/s.
pub const LEAD_TICKS: u32 = UPDATE_LEAD_TICKS + UPDATE_INTERVAL_TICKS - 1 + 3;

/// The lead in updates.
const LEAD: f32 = LEAD_TICKS as f32 / UPDATE_INTERVAL_TICKS as f32;

/// Steps of a position per mm.
const STEPS_PER_MM: f32 = (1u64 << Position::FRACTION_BITS) as f32;

/// Fraction of the difference from the host's position that an update corrects.
const HOST_SHARE: f32 = 0.2;

/// Difference from the host's position above which the tool was put down elsewhere: a distance, mm, plus the distance
/// that it moves in a time, s.
const HOST_ELSEWHERE: (f32, f32) = (1.0, 0.02);

/// The host's motion.
#[derive(Clone, Copy, Debug)]
pub struct HostMotion {
    /// Position, mm, finite, if the host sent one.
    pub position_mm: Option<f32>,
    /// Speed, mm/s, with a sign if the host sent one.
    pub speed_mm_s: f32,
    /// Tick of the motion.
    pub at: Option<u64>,
}

/// Follower of the tool's position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tracker(Option<Tracked>);

/// The tracked position, and its motion.
#[derive(Clone, Copy, Debug)]
struct Tracked {
    position: Position,
    /// Velocity, mm per update.
    velocity: f32,
    /// Acceleration, mm per update².
    acceleration: f32,
    /// The position by the encoder, and the encoder's count there.
    counted: Position,
    counts: i32,
    /// The host's last position, mm, and the tick of its last motion.
    told_mm: Option<f32>,
    told_at: Option<u64>,
}

impl Tracker {
    /// A tracker that has seen nothing yet.
    pub const fn new() -> Self {
        Self(None)
    }

    /// Returns the position [`LEAD_TICKS`] after tick `now`. It follows the host's motion if there is one (`told`), and
    /// otherwise the `estimator` of the encoder, whose counts are `path_per_count` mm long.
    ///
    /// The origin of the encoder's path is its count at the first call.
    pub fn follow(
        &mut self,
        told: Option<HostMotion>,
        estimator: &Estimator,
        path_per_count: f32,
        now: u64,
    ) -> Position {
        let counts = estimator.counts();
        let tracked = self.0.get_or_insert(Tracked {
            position: Position::ORIGIN,
            velocity: 0.0,
            acceleration: 0.0,
            counted: Position::ORIGIN,
            counts,
            told_mm: None,
            told_at: None,
        });
        tracked.count(counts, path_per_count);
        match told {
            None => tracked.follow_encoder(estimator, path_per_count),
            Some(told) => tracked.follow_host(told, now),
        }
        tracked.ahead()
    }
}

impl Tracked {
    /// Advances the counted position to the encoder's `counts`, which wrap. The sum is exact, so that a place has the
    /// same position in both directions.
    fn count(&mut self, counts: i32, path_per_count: f32) {
        let step = steps(path_per_count);
        let more = i64::from(counts.wrapping_sub(self.counts));
        self.counted = self.counted.ahead(more.wrapping_mul(step));
        self.counts = counts;
    }

    fn follow_encoder(&mut self, estimator: &Estimator, path_per_count: f32) {
        let within_mm = estimator.within_count() * path_per_count;
        self.position = self.counted.ahead(steps(within_mm));
        [self.velocity, self.acceleration] = estimator.course().map(|of| of * path_per_count);
    }

    fn follow_host(&mut self, host: HostMotion, now: u64) {
        self.acceleration = 0.0;
        self.go(self.velocity);
        // A host may send less often than the updates come. Each of its positions corrects once.
        if host.at == self.told_at {
            return;
        }
        // A motion that came after the tick's note was written has age zero.
        let age = host.at.map_or(0, |at| now.saturating_sub(at)) as f32;
        let gone_mm = match (host.position_mm, self.told_mm) {
            (Some(told), Some(before)) => told - before,
            _ => 0.0,
        };
        // The positions determine the direction, because some hosts leave out the sign of the speed.
        let speed = if gone_mm == 0.0 {
            host.speed_mm_s
        } else {
            host.speed_mm_s.abs().copysign(gone_mm)
        };
        self.velocity = speed * UPDATE_INTERVAL_TICKS as f32 / SAMPLE_RATE_HZ as f32;
        (self.told_mm, self.told_at) = (host.position_mm, host.at);
        let Some(told_mm) = host.position_mm else {
            return;
        };
        let told = Position::from_mm(told_mm).ahead(steps(speed * age / SAMPLE_RATE_HZ as f32));
        let miss_mm = mm(told.since(self.position));
        let (slack_mm, slack_s) = HOST_ELSEWHERE;
        if miss_mm.abs() > slack_mm + slack_s * speed.abs() {
            self.position = told;
        } else {
            self.go(HOST_SHARE * miss_mm);
        }
    }

    fn go(&mut self, way_mm: f32) {
        self.position = self.position.ahead(steps(way_mm));
    }

    /// The position at the end of the lead.
    fn ahead(&self) -> Position {
        let way_mm = self.velocity * LEAD + self.acceleration * (LEAD * LEAD / 2.0);
        self.position.ahead(steps(way_mm))
    }
}

fn steps(way_mm: f32) -> i64 {
    (way_mm * STEPS_PER_MM) as i64
}

fn mm(steps: i64) -> f32 {
    steps as f32 / STEPS_PER_MM
}
