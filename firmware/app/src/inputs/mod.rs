//! Speed, force, position and contact, with their age: from the encoder and the force sensor, or from the host.
//!
//! **Force** is (code - zero) times a constant. **Speed** is the magnitude of the [`estimator`]'s velocity, times the
//! path per count. It lags by half a millisecond while the hand accelerates.
//!
//! **Position** is the encoder's count since playing began, times the path per count. **Contact** follows from the
//! force, see [`ContactDetector`], for a texture as well as for a scene. The host may send a position or contact of its
//! own instead.
//!
//! **The threshold of contact** is a setting, or by default 6 standard deviations of the converter's noise, see
//! [`FORCE_NOISE_CODES`], and at least [`ContactThreshold::LEAST`]. The force has no filter, so an update sees the
//! noise of one conversion. One of 10⁹ Gaussian values lies above 6 deviations, which is one false contact in 23 days.
//! Contact ends at 3 deviations.
//!
//! **Lines that are tied to position** need a finer position than whole counts, without a delay. The
//! [`Tracker`] computes it with the same estimator.
//!
//! An input that is older than [`STALE_TICKS`] is stale and mutes the output. A force at a rail of the converter, see
//! [`RAIL_CODES`], is not used: contact ends at once, and the motion becomes stale.

pub mod estimator;

pub use model_format::link::RAIL_CODES;
use model_format::link::{MotionRefused, MotionSample, MotionSource, STALE_AFTER_MS, Setting, Settings};
use model_format::{AdcCode, MillimetresPerSecond, Newton};
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction};
use stylus_kernel::{Motion, MotionError};

use crate::{SAMPLE_RATE_HZ, TICKS_PER_MS, UPDATE_INTERVAL_TICKS};
pub use estimator::Estimator;
use estimator::{HostMotion, Tracker};

/// Greatest age of an input that is not stale, ticks.
pub const STALE_TICKS: u64 = (STALE_AFTER_MS * TICKS_PER_MS) as u64;

/// Standard deviation of the force's code at rest.
///
/// The deviation was not measured in this project. Users of a NUCLEO-H743ZI report 100 codes from peak to peak of a
/// grounded pin, because the clock of the Ethernet transceiver reaches the converter (ST community, "Fluctuations in
/// ADC value of STM32H743 MCU"). That is 6 deviations of 16 codes. If a sensor's amplifier adds more noise, the
/// threshold must be set.
pub const FORCE_NOISE_CODES: f32 = 16.0;

/// Force at which contact begins, in standard deviations of the noise.
const CONTACT_DEVIATIONS: f32 = 6.0;

/// Conversion of counts and codes to speed, position and force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputConfig {
    /// Path per count, mm.
    path_per_count: f32,
    force_zero: AdcCode,
    /// Force per code, N.
    force_per_code: f32,
    contact: ContactThreshold,
}

impl InputConfig {
    /// The conversion by `settings`.
    pub fn new(settings: &Settings) -> Self {
        let path_per_count = settings.get(Setting::PathPerCount);
        let force_per_code = settings.get(Setting::ForcePerVolt) * AdcCode::STEP.0;
        Self {
            path_per_count,
            force_zero: settings.force_zero(),
            force_per_code,
            contact: contact_threshold(settings.get(Setting::ContactThreshold), force_per_code),
        }
    }

    /// Threshold of contact.
    pub fn contact(&self) -> ContactThreshold {
        self.contact
    }

    /// Force of `code`.
    pub fn force(&self, code: AdcCode) -> Newton {
        let codes = i32::from(code.0) - i32::from(self.force_zero.0);
        Newton(codes as f32 * self.force_per_code)
    }

    /// Speed of `counts` per block.
    fn speed(&self, counts: f32) -> MillimetresPerSecond {
        const BLOCKS_PER_SECOND: f32 = SAMPLE_RATE_HZ as f32 / UPDATE_INTERVAL_TICKS as f32;
        MillimetresPerSecond((counts * self.path_per_count * BLOCKS_PER_SECOND).abs())
    }

    /// Position `counts` from the origin, mm.
    fn position_mm(&self, counts: i32) -> f32 {
        counts as f32 * self.path_per_count
    }
}

/// Returns the threshold of contact: the setting `set_n`, N, or, if that is 0, the threshold that follows from the
/// noise at `force_per_code`, N.
fn contact_threshold(set_n: f32, force_per_code: f32) -> ContactThreshold {
    if set_n > 0.0 {
        return ContactThreshold::new(Newton(set_n));
    }
    let of_noise = CONTACT_DEVIATIONS * FORCE_NOISE_CODES * force_per_code.abs();
    ContactThreshold::new(Newton(of_noise.max(ContactThreshold::LEAST.begins_n())))
}

/// Follower of a 16-bit quadrature counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoder {
    count: u16,
}

impl Encoder {
    /// A follower of a counter that stands at `count`.
    pub const fn new(count: u16) -> Self {
        Self { count }
    }

    /// Returns the counter's change to `count` modulo 2¹⁶, which is correct for up to 32 767 counts per tick.
    #[inline(always)]
    pub fn delta(&mut self, count: u16) -> i16 {
        let delta = count.wrapping_sub(self.count) as i16;
        self.count = count;
        delta
    }
}

/// Counts of a block.
#[derive(Clone, Copy, Debug)]
struct Counted {
    counts: i32,
    /// Sum over the block's ticks of the counts since the block's beginning.
    sum: i32,
}

impl Counted {
    const NONE: Self = Self { counts: 0, sum: 0 };
}

/// Last values of the sensors, gathered by the tick.
#[derive(Clone, Copy, Debug)]
pub struct Sensors {
    /// The block under way.
    block: Counted,
    /// The last whole block, and the number of whole blocks, which wraps.
    last: Counted,
    ended: u32,
    /// Counts of all blocks, modulo 2³².
    counts: i32,
    force: AdcCode,
    /// True if the last conversion that was in time was within [`RAIL_CODES`] of a rail.
    railed: bool,
    /// Tick at which the last good conversion was read.
    updated_at: Option<u64>,
}

impl Default for Sensors {
    fn default() -> Self {
        Self::new()
    }
}

impl Sensors {
    /// Sensors before anything has been read.
    pub const fn new() -> Self {
        Self {
            block: Counted::NONE,
            last: Counted::NONE,
            ended: 0,
            counts: 0,
            force: AdcCode(0),
            railed: false,
            updated_at: None,
        }
    }

    /// Adds the values read at `tick`. The last force stays if the conversion of `force` was not in time (`fresh` is
    /// false), or if `force` is at a rail.
    #[inline(always)]
    pub fn read(&mut self, tick: u64, encoder_delta: i16, force: AdcCode, fresh: bool) {
        self.block.counts = self.block.counts.wrapping_add(i32::from(encoder_delta));
        self.block.sum = self.block.sum.wrapping_add(self.block.counts);
        // One comparison for both rails: a code below the lower bound wraps to a large number.
        let inside = force.0.wrapping_sub(RAIL_CODES) <= u16::MAX - 2 * RAIL_CODES;
        if fresh {
            self.railed = !inside;
        }
        if fresh & inside {
            self.force = force;
            self.updated_at = Some(tick);
        }
    }

    /// Ends a block of the encoder's counts, [`UPDATE_INTERVAL_TICKS`] long. The tick calls it when an update is due,
    /// [`UPDATE_LEAD_TICKS`](crate::UPDATE_LEAD_TICKS) before the next block is played, whatever the source of motion.
    #[inline(always)]
    pub fn end_block(&mut self) {
        self.counts = self.counts.wrapping_add(self.block.counts);
        self.last = core::mem::replace(&mut self.block, Counted::NONE);
        self.ended = self.ended.wrapping_add(1);
    }

    /// Returns the motion at `speed` with the force of the last good conversion, and that conversion's tick.
    fn moving_at(&self, speed: MillimetresPerSecond, config: &InputConfig) -> Timed {
        // Speed and force are products of finite numbers in range, so they make a motion.
        let motion = Motion::new(speed, config.force(self.force));
        Timed {
            motion: motion.unwrap_or(Motion::REST),
            source: MotionSource::Sensors,
            speed_mm_s: motion.map_or(0.0, |motion| motion.speed_mm_s()),
            position_mm: None,
            contact: self.railed.then_some(false),
            at: self.updated_at,
        }
    }

    /// Sets the number of blocks and the encoder's count shortly before they wrap, for tests.
    pub const fn age(&mut self) {
        self.ended = u32::MAX - SAMPLE_RATE_HZ / UPDATE_INTERVAL_TICKS;
        self.counts = i32::MAX - 100;
    }

    /// Returns true if the force is at a rail of its converter, and therefore unknown.
    pub fn is_railed(&self) -> bool {
        self.railed
    }
}

/// A motion and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed {
    /// The motion.
    pub motion: Motion,
    /// Source of the motion.
    pub source: MotionSource,
    /// Speed, mm/s, with a sign if the host sent one.
    pub speed_mm_s: f32,
    /// Position on the path, mm, finite. If `None`, the position by the encoder is used.
    pub position_mm: Option<f32>,
    /// True if the tool touches. If `None`, the force decides.
    ///
    /// A motion of the sensors has `Some(false)` while the force is at a rail.
    pub contact: Option<bool>,
    /// Tick of the input; none before the first one.
    pub at: Option<u64>,
}

impl Timed {
    /// No input so far.
    pub const NEVER: Self = Self {
        motion: Motion::REST,
        source: MotionSource::Host,
        speed_mm_s: 0.0,
        position_mm: None,
        contact: None,
        at: None,
    };

    /// The host's sample, received at `tick`.
    pub fn from_host(sample: MotionSample, tick: u64) -> Result<Self, MotionRefused> {
        let motion = Motion::new(sample.speed, sample.force).map_err(|error| match error {
            MotionError::Speed => MotionRefused::Speed,
            MotionError::Force => MotionRefused::Force,
        })?;
        if sample.position_mm.is_some_and(|position| !position.is_finite()) {
            return Err(MotionRefused::Position);
        }
        Ok(Self {
            motion,
            source: MotionSource::Host,
            speed_mm_s: sample.speed.0,
            position_mm: sample.position_mm,
            contact: sample.contact,
            at: Some(tick),
        })
    }

    /// Returns true if the motion is too old at `tick`.
    pub fn is_stale(&self, tick: u64) -> bool {
        // An input noted just after `tick` was read has age zero.
        self.at.is_none_or(|at| tick.saturating_sub(at) > STALE_TICKS)
    }
}

/// The motion that `source` selects. A stale motion is returned unchanged, because the mute fades it out.
pub fn choose(source: MotionSource, sensors: Timed, host: Timed) -> Timed {
    match source {
        MotionSource::Sensors => sensors,
        MotionSource::Host => host,
    }
}

/// Follower of the hand from the time that playing began.
#[derive(Clone, Copy, Debug, Default)]
pub struct Follower {
    /// True if the position is used. Otherwise the tool stays at the path's origin.
    locates: bool,
    /// Count of the encoder at the origin, once it is known.
    origin: Option<i32>,
    /// The tracker for lines that are tied to position, if what is played has such lines.
    tracker: Option<Tracker>,
    contact: ContactDetector,
}

impl Follower {
    /// A follower that has seen nothing yet. A scene depends on the position (`locates`), a texture does not.
    pub const fn new(locates: bool) -> Self {
        Self {
            locates,
            origin: None,
            tracker: None,
            contact: ContactDetector::new(),
        }
    }

    /// Returns this follower, with a tracker if the plan has lines that are tied to position (`has_lines`).
    #[must_use]
    pub fn tracking(self, has_lines: bool) -> Self {
        let tracker = has_lines.then(Tracker::new);
        Self { tracker, ..self }
    }

    /// Returns the interaction of the hand at tick `now`, from the chosen motion and the encoder. If the position is
    /// used, its origin is the encoder's count at the first call.
    pub fn follow(&mut self, chosen: Timed, encoder: &Estimator, config: &InputConfig, now: u64) -> Interaction {
        // Called also if the host states contact, so that the detector's hysteresis knows every force.
        let by_force = self.contact.touches(chosen.motion, config.contact);
        let contact = chosen.contact.unwrap_or(by_force);
        let position = if self.locates {
            let counts = encoder.counts();
            let origin = *self.origin.get_or_insert(counts);
            let by_encoder = config.position_mm(counts.wrapping_sub(origin));
            chosen.position_mm.unwrap_or(by_encoder)
        } else {
            0.0
        };
        // Both positions are finite: the host's was checked, and the encoder's is at most 2³¹ times a setting in its
        // range.
        let interaction = Interaction::new(chosen.motion, position, contact).unwrap_or(Interaction::NONE);
        let told = (chosen.source == MotionSource::Host).then_some(HostMotion {
            position_mm: chosen.position_mm,
            speed_mm_s: chosen.speed_mm_s,
            at: chosen.at,
        });
        let path_per_count = config.path_per_count;
        let tracker = self.tracker.as_mut();
        interaction.reaching(tracker.map(|tracker| tracker.follow(told, encoder, path_per_count, now)))
    }
}
