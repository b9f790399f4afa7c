//! Position of the tool when a block's last sample is felt, for lines that are locked to place.
//!
//! **From the encoder.** A count is a step of the path, and the tool is somewhere within it. A filter of position,
//! velocity and acceleration with fading memory interpolates between counts, once per update of 2 ms, and looks
//! [`LEAD_TICKS`] ahead. Its estimate is never outside of the present count, so that the surface is the same forwards
//! and backwards. The gains are those of the polynomial of degree 2 with weights that fall by θ per update
//! (Morrison, *Introduction to Sequential Smoothing and Prediction*, 1969): θ is 0.85, a memory of 13 ms, and 0.6 when
//! the prediction misses by two counts, because a hand that turns would otherwise outrun it.
//!
//! It has no lag at constant speed and acceleration. With counts of 0.01 mm and at 20 to 300 mm/s the position felt is
//! off by at most 5 µm RMS and by a count, so that the phase noise of a line of 0.6 mm is at most 3° RMS. A turn at
//! 100 mm/s is off by a count if it takes 0.9 s, and by 2 to 3 counts for a moment if it takes 0.3 s, because nobody
//! knows the jerk ahead. Counts that flicker, because the tool is at the edge of a count whenever it is read, leave up
//! to twice that. `firmware/app/tests/app/lines.rs` holds these figures.
//!
//! **From the host.** Its positions come at up to 1 kHz, and up to a millisecond late or early. The position goes on at
//! the speed that the host told last, and takes up a fifth of the difference per update. Without positions it is the
//! integral of the signed speed.

use stylus_kernel::position::Position;

use crate::{SAMPLE_RATE_HZ, UPDATE_INTERVAL_TICKS};

/// Ticks from the reading of the inputs until the last sample of the block that they decide is felt.
///
/// The block that begins with the next update has its last sample 19 ticks later. Its codes begin 1.1 ticks after that,
/// and the interpolation filter delays them by 1.7. At 10 kHz the last sample comes half a tick later in its tick, and
/// is delayed by 0.8, so it is felt 0.4 ticks earlier: 8 µm at 100 mm/s.
pub const LEAD_TICKS: u32 = 2 * UPDATE_INTERVAL_TICKS - 1 + 3;

/// The lead in updates.
const LEAD: f32 = LEAD_TICKS as f32 / UPDATE_INTERVAL_TICKS as f32;

/// Steps of a position per mm.
const STEPS_PER_MM: f32 = (1u64 << Position::FRACTION_BITS) as f32;

/// Gains of position, velocity and acceleration.
#[derive(Clone, Copy)]
struct Gains([f32; 3]);

/// Gains of a steady hand, θ = 0.85.
const STEADY: Gains = Gains::of_memory(0.85);

/// Gains of a hand that turns, θ = 0.6.
const TURNING: Gains = Gains::of_memory(0.6);

/// Difference of prediction and encoder at which the gains begin to grow, counts. Up to half a count is resolution.
const STEADY_COUNTS: f32 = 0.8;

/// Difference from which on they are those of a hand that turns.
const TURNING_COUNTS: f32 = 2.1;

/// Difference from which on the tool was put elsewhere, mm. In 2 ms no hand changes its path by that.
const ELSEWHERE_MM: f32 = 5.0;

/// Share of the difference to the host's position that an update takes up.
const HOST_SHARE: f32 = 0.2;

/// Difference to the host's position from which on the tool was put elsewhere, mm, and s of its speed besides.
const HOST_ELSEWHERE: (f32, f32) = (1.0, 0.02);

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

/// The host's motion.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// Position, mm, finite, if the host told it.
    pub position_mm: Option<f32>,
    /// Speed, mm/s, with its sign if the host told it.
    pub speed_mm_s: f32,
    /// Tick of the motion.
    pub at: Option<u64>,
}

/// Follower of the tool's position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tracker(Option<Tracked>);

/// The position as far as it is known.
#[derive(Clone, Copy, Debug)]
struct Tracked {
    position: Position,
    /// Velocity, mm per update.
    velocity: f32,
    /// Acceleration, mm per update and update.
    acceleration: f32,
    /// The encoder's position, and the counts that it is of.
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

    /// The position, [`LEAD_TICKS`] after tick `now`, by the host if it `told` a motion, and else by the encoder's
    /// `counts` of `path_per_count` mm.
    ///
    /// The origin of the encoder's path is its count at the first call.
    pub fn follow(
        &mut self,
        told: Option<Told>,
        counts: i32,
        path_per_count: f32,
        now: u64,
    ) -> Position {
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
            None => tracked.follow_encoder(path_per_count),
            Some(told) => tracked.follow_host(told, now),
        }
        tracked.ahead()
    }
}

impl Tracked {
    /// Takes the encoder's `counts`, which wrap. The sum is exact, so that a place is the same in both directions.
    fn count(&mut self, counts: i32, path_per_count: f32) {
        let step = steps(path_per_count);
        let more = i64::from(counts.wrapping_sub(self.counts));
        self.counted = self.counted.ahead(more.wrapping_mul(step));
        self.counts = counts;
    }

    fn follow_encoder(&mut self, path_per_count: f32) {
        // A path per count of 0 is allowed, and keeps the tool where it is.
        let count_mm = path_per_count.abs().max(f32::MIN_POSITIVE);
        // Both ends of a count are the same in both directions, so that the tool is in its middle on the average.
        let middle = self.counted.ahead(steps(path_per_count / 2.0));
        self.go(self.velocity + self.acceleration / 2.0);
        self.velocity += self.acceleration;
        let miss_mm = mm(middle.since(self.position));
        if miss_mm.abs() > ELSEWHERE_MM {
            (self.position, self.velocity, self.acceleration) = (middle, 0.0, 0.0);
            return;
        }
        let Gains([position, velocity, acceleration]) = Gains::of_miss(miss_mm.abs() / count_mm);
        self.go(position * miss_mm);
        self.velocity += velocity * miss_mm;
        self.acceleration += acceleration * miss_mm;
        // Within the count, whatever was predicted.
        let half = steps(count_mm / 2.0);
        let off = self.position.since(middle).clamp(-half, half);
        self.position = middle.ahead(off);
    }

    fn follow_host(&mut self, host: Told, now: u64) {
        self.acceleration = 0.0;
        self.go(self.velocity);
        if host.at == self.told_at {
            return;
        }
        let age = host.at.map_or(0, |at| now.saturating_sub(at)) as f32;
        let gone_mm = match (host.position_mm, self.told_mm) {
            (Some(told), Some(before)) => told - before,
            _ => 0.0,
        };
        // Positions tell the direction better than a sign that some hosts leave out.
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

    /// The position after the lead.
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
