//! Speed, force, place and contact: from the encoder and the force sensor, or from the host, with their age.
//!
//! **Force** is (code - zero) times a constant. **Speed** is the change of the encoder's count over the last
//! [`WINDOW_TICKS`] ticks, 20 ms, times the path of a count, over that time: the mean speed of 10 ms ago. One count is
//! path-per-count / 20 ms of it, 0.5 mm/s for counts of 0.01 mm. The direction does not matter.
//!
//! **Place** is the encoder's count since playing began, times the path of a count. **Contact** follows from the force, see
//! [`ContactDetector`]. The host may give either of them.
//!
//! An input that is older than [`STALE_TICKS`] is no longer believed.

use model_format::link::{
    MotionRefused, MotionSample, MotionSource, STALE_AFTER_MS, Setting, Settings,
};
use model_format::{AdcCode, MillimetresPerSecond, Newton};
use stylus_kernel::scene::{ContactDetector, Interaction};
use stylus_kernel::{Motion, MotionError, UPDATE_INTERVAL_SAMPLES};

use crate::{SAMPLE_RATE_HZ, TICKS_PER_MS};

/// Age from which an input is not believed, ticks.
pub const STALE_TICKS: u64 = (STALE_AFTER_MS * TICKS_PER_MS) as u64;

/// Blocks of ticks over which the speed is taken.
const WINDOW_BLOCKS: usize = 10;

/// Ticks over which the speed is taken.
pub const WINDOW_TICKS: u32 = WINDOW_BLOCKS as u32 * UPDATE_INTERVAL_SAMPLES;

/// What turns counts and codes into speed and force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputConfig {
    /// mm/s for a count in the window.
    speed_per_count: f32,
    /// mm.
    path_per_count: f32,
    force_zero: AdcCode,
    /// N for a code.
    force_per_code: f32,
}

impl InputConfig {
    /// For `settings`.
    pub fn new(settings: &Settings) -> Self {
        let windows_per_second = SAMPLE_RATE_HZ as f32 / WINDOW_TICKS as f32;
        let path_per_count = settings.get(Setting::PathPerCount);
        Self {
            speed_per_count: path_per_count * windows_per_second,
            path_per_count,
            force_zero: settings.force_zero(),
            force_per_code: settings.get(Setting::ForcePerVolt) * AdcCode::STEP.0,
        }
    }

    /// The force that `code` stands for.
    pub fn force(&self, code: AdcCode) -> Newton {
        let codes = i32::from(code.0) - i32::from(self.force_zero.0);
        Newton(codes as f32 * self.force_per_code)
    }

    /// The speed of `counts` in a window.
    fn speed(&self, counts: i32) -> MillimetresPerSecond {
        MillimetresPerSecond((counts as f32 * self.speed_per_count).abs())
    }

    /// The place `counts` from the origin, mm.
    fn position_mm(&self, counts: i32) -> f32 {
        counts as f32 * self.path_per_count
    }
}

/// Follows the count of a 16-bit quadrature counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoder {
    count: u16,
}

impl Encoder {
    /// A counter that stands at `count`.
    pub const fn new(count: u16) -> Self {
        Self { count }
    }

    /// By how much the counter has changed to `count`, the short way round: right up to 32 767 counts a tick.
    #[inline(always)]
    pub fn delta(&mut self, count: u16) -> i16 {
        let delta = count.wrapping_sub(self.count) as i16;
        self.count = count;
        delta
    }
}

/// The sensors' last values, gathered by the tick.
#[derive(Clone, Copy, Debug)]
pub struct Sensors {
    /// Counts of the block that is under way.
    block_counts: i32,
    /// Counts of the blocks before, round about.
    blocks: [i32; WINDOW_BLOCKS],
    oldest: usize,
    /// Counts of all blocks, round about 2³².
    counts: i32,
    force: AdcCode,
    /// The tick at which the last good conversion was read.
    updated_at: Option<u64>,
}

impl Default for Sensors {
    fn default() -> Self {
        Self::new()
    }
}

impl Sensors {
    /// Nothing has been read.
    pub const fn new() -> Self {
        Self {
            block_counts: 0,
            blocks: [0; WINDOW_BLOCKS],
            oldest: 0,
            counts: 0,
            force: AdcCode(0),
            updated_at: None,
        }
    }

    /// What was read at `tick`. `fresh` tells whether the conversion was there in time; if not, `force` is left out.
    #[inline(always)]
    pub fn read(&mut self, tick: u64, encoder_delta: i16, force: AdcCode, fresh: bool) {
        self.block_counts = self.block_counts.saturating_add(i32::from(encoder_delta));
        if fresh {
            self.force = force;
            self.updated_at = Some(tick);
        }
    }

    /// Ends a block of [`UPDATE_INTERVAL_SAMPLES`] ticks. Called at each block's boundary, whoever gives the motion.
    #[inline(always)]
    pub fn end_block(&mut self) {
        self.blocks[self.oldest] = self.block_counts;
        self.oldest = (self.oldest + 1) % WINDOW_BLOCKS;
        self.counts = self.counts.wrapping_add(self.block_counts);
        self.block_counts = 0;
    }

    /// The motion of the last window, and the tick at which it was good.
    pub fn motion(&self, config: &InputConfig) -> Timed {
        let counts = self
            .blocks
            .iter()
            .fold(0i32, |sum, &block| sum.saturating_add(block));
        // Both are products of finite numbers in range, so this is a motion.
        let motion = Motion::new(config.speed(counts), config.force(self.force));
        Timed {
            motion: motion.unwrap_or(Motion::REST),
            position_mm: None,
            contact: None,
            at: self.updated_at,
        }
    }

    /// Where the encoder stood at the end of the last block, in counts, round about 2³².
    pub fn counts(&self) -> i32 {
        self.counts
    }
}

/// A motion and when it was good.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed {
    /// The motion.
    pub motion: Motion,
    /// The place on the path, mm, and finite; none leaves it to the encoder.
    pub position_mm: Option<f32>,
    /// Whether the tool touches; none leaves it to the force.
    pub contact: Option<bool>,
    /// The tick, none if there was no input yet.
    pub at: Option<u64>,
}

impl Timed {
    /// No input yet.
    pub const NEVER: Self = Self {
        motion: Motion::REST,
        position_mm: None,
        contact: None,
        at: None,
    };

    /// What the host says at `tick`.
    ///
    /// # Errors
    /// A speed, force or position that is not finite.
    pub fn from_host(sample: MotionSample, tick: u64) -> Result<Self, MotionRefused> {
        let motion = Motion::new(sample.speed, sample.force).map_err(|error| match error {
            MotionError::Speed => MotionRefused::Speed,
            MotionError::Force => MotionRefused::Force,
        })?;
        if sample
            .position_mm
            .is_some_and(|position| !position.is_finite())
        {
            return Err(MotionRefused::Position);
        }
        Ok(Self {
            motion,
            position_mm: sample.position_mm,
            contact: sample.contact,
            at: Some(tick),
        })
    }

    /// Whether the motion is too old to be believed at `tick`.
    pub fn is_stale(&self, tick: u64) -> bool {
        // An input noted a moment after the tick was read has no age.
        self.at
            .is_none_or(|at| tick.saturating_sub(at) > STALE_TICKS)
    }
}

/// What of `sensors` and `host` is followed by `source`. A stale motion is what it was: the mute fades it out.
pub fn choose(source: MotionSource, sensors: Timed, host: Timed) -> Timed {
    match source {
        MotionSource::Sensors => sensors,
        MotionSource::Host => host,
    }
}

/// How a hand is followed from the moment that playing began.
#[derive(Clone, Copy, Debug, Default)]
pub struct Follower {
    /// Whether place and contact count; if not, the tool touches the path's origin for ever.
    locates: bool,
    /// The encoder's count at the origin, as soon as it is known.
    origin: Option<i32>,
    contact: ContactDetector,
}

impl Follower {
    /// One that has not seen anything yet. What a scene plays depends on place and contact, what a texture plays does not.
    pub const fn new(locates: bool) -> Self {
        Self {
            locates,
            origin: None,
            contact: ContactDetector::new(),
        }
    }

    /// What the hand does, by the motion that was chosen and the sensors at the same time. The origin is where the encoder
    /// stands when this is called first.
    pub fn follow(
        &mut self,
        chosen: Timed,
        sensors: &Sensors,
        config: &InputConfig,
    ) -> Interaction {
        if !self.locates {
            return Interaction::touching(chosen.motion);
        }
        let counts = sensors.counts();
        let origin = *self.origin.get_or_insert(counts);
        let by_encoder = config.position_mm(counts.wrapping_sub(origin));
        let position = chosen.position_mm.unwrap_or(by_encoder);
        let by_force = self.contact.touches(chosen.motion);
        let contact = chosen.contact.unwrap_or(by_force);
        // Both positions are finite: the host's was checked, and a count is at most 2³¹ of a setting in its range.
        Interaction::new(chosen.motion, position, contact).unwrap_or(Interaction::NONE)
    }
}
