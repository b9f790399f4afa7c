//! Position of the tool when a block's last sample is felt, for lines that are tied to position.
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

use super::estimator::Estimator;
use crate::{SAMPLE_RATE_HZ, UPDATE_INTERVAL_TICKS, UPDATE_LEAD_TICKS};

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
