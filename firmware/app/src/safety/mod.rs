//! Safety stages between a sample of the kernel and a code for the converter, so that no sample can harm the coil or
//! the hand.
//!
//! ```text
//! OutputSample -> gain -> DC blocker -> mute ramp -> thermal limiter -> hard limit -> slew limit -> DacCode
//!                                                         ^                                          |
//!                                                         +--------------- coil model <--------------+
//! ```
//! The ramp comes after the DC blocker, so that a muted output is at exactly mid-scale when the ramp has ended, without
//! the blocker's tail. The coil's model is fed with the codes that are put out, not with its own input.
//!
//! A sample takes integer arithmetic and the same path for all data. [`Config`] is computed from settings, in
//! floating-point operations that IEEE 754 defines to the last bit, so that host and device put out the same codes.

mod dc_blocker;
mod fixed;
mod ramp;
mod thermal;

use model_format::link::{Setting, Settings};
use model_format::{DacCode, OutputSample};

use crate::SAMPLE_RATE_HZ;
use dc_blocker::DcBlocker;
use fixed::{STEP_BITS, round_to_step, within};
use ramp::{Ramp, RampConfig};
use thermal::{CoilConfig, CoilState};

pub use thermal::PEAK_POWER_RATIO;

/// Binary digits after the point of the gain.
const GAIN_BITS: u32 = 20;

/// Largest magnitude of the input of the stages after the gain: half the converter's range, in 2^-16 steps.
const FULL_SCALE: i64 = 2048 << STEP_BITS;

/// Number of codes for the converter per sample of the kernel. They are put out at equal intervals.
pub const OVERSAMPLING: usize = 8;

/// Codes per second at the pin.
pub const PIN_RATE_HZ: u32 = SAMPLE_RATE_HZ * OVERSAMPLING as u32;

/// Configuration of the safety stages, computed when settings or the played texture change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Converter steps of 2^-16 per step of the kernel's output, in 2^-20.
    gain: i32,
    ramp: RampConfig,
    coil: CoilConfig,
    /// Largest offset from mid-scale, converter steps.
    limit: i32,
    /// Largest change from one code to the next, converter steps.
    slew: i32,
}

impl Config {
    /// The configuration by `settings` for playing at `play_gain`, which must be finite and not negative.
    pub fn new(settings: &Settings, play_gain: f32) -> Self {
        let per_step = 1.0 / DacCode::STEP.0;
        let steps_per_acceleration = settings.get(Setting::OutputGain) * play_gain * per_step;
        // From 2^-20 m/s² to 2^-16 steps is a division by 2^4.
        let scale = (1u32 << (GAIN_BITS - OutputSample::FRACTION_BITS + STEP_BITS)) as f32;
        let coil = CoilConfig::new(settings);
        let limit = (settings.hard_limit().0 * per_step) as i32;
        let slew_per_code = settings.get(Setting::SlewLimit) * 1e3 / PIN_RATE_HZ as f32;
        Self {
            // The conversion of a float saturates.
            gain: (steps_per_acceleration * scale) as i32,
            ramp: RampConfig::new(settings),
            coil,
            limit: limit.min(coil.peak_limit()),
            slew: ((slew_per_code * per_step) as i32).max(1),
        }
    }

    /// Largest offset of the output from mid-scale, converter steps: the hard limit, or the limit by
    /// [`PEAK_POWER_RATIO`].
    pub fn limit_steps(&self) -> i32 {
        self.limit
    }

    /// Largest change from one code to the next, converter steps.
    pub fn slew_steps(&self) -> i32 {
        self.slew
    }

    /// Most samples from any output to exactly mid-scale after a mute.
    pub fn mute_samples(&self) -> u32 {
        // The slew limit may lag behind the end of the ramp, by at most the time from one limit to mid-scale.
        self.ramp.down_samples() + (self.limit / self.slew) as u32 / OVERSAMPLING as u32 + 2
    }
}

/// State and counters of the safety stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    dc_blocker: DcBlocker,
    ramp: Ramp,
    coil: CoilState,
    /// Last output, converter steps from mid-scale.
    offset: i32,
    counters: Counters,
}

/// Numbers of samples that the safety stages changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Samples that the hard limit cut.
    pub hard_limited: u32,
    /// Samples that the slew limit held back.
    pub slew_limited: u32,
    /// Samples that the thermal limiter attenuated.
    pub thermally_limited: u32,
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

impl State {
    /// State at mid-scale and muted. The coil counts as warm as it may be without attenuation, because its state is
    /// unknown.
    pub const fn new() -> Self {
        Self {
            dc_blocker: DcBlocker::new(),
            ramp: Ramp::new(),
            coil: CoilState::new(),
            offset: 0,
            counters: Counters {
                hard_limited: 0,
                slew_limited: 0,
                thermally_limited: 0,
            },
        }
    }

    /// The next codes for the converter, in the order in which they are put out.
    ///
    /// While `muted`, the output goes to mid-scale along the mute ramp and stays there. Afterwards it returns along the
    /// soft start.
    #[inline(always)]
    pub fn process(
        &mut self,
        config: &Config,
        sample: OutputSample,
        muted: bool,
    ) -> [DacCode; OVERSAMPLING] {
        let product = i64::from(sample.0) * i64::from(config.gain);
        let amplified = fixed::shift_toward_zero(product, GAIN_BITS).clamp(-FULL_SCALE, FULL_SCALE);
        let without_dc = self.dc_blocker.next(amplified);
        let ramped = self.ramp.next(config.ramp, without_dc, muted);
        let (cooled, attenuated) = self.coil.attenuate(ramped);
        let requested = round_to_step(cooled);
        let limited = within(requested, -config.limit, config.limit);
        let mut held_back = false;
        let codes = core::array::from_fn(|_| {
            let (low, high) = (self.offset - config.slew, self.offset + config.slew);
            self.offset = within(limited, low, high);
            held_back |= self.offset != limited;
            self.coil.follow(config.coil, self.offset);
            DacCode::from_mid_scale(self.offset)
        });
        self.counters
            .count(requested != limited, held_back, attenuated);
        codes
    }

    /// Makes the next codes continue from the one `offset` steps from mid-scale, which is put out just before them.
    ///
    /// After a tick that came late, that is not the last code that was computed, and the slew limit holds at the pin.
    #[inline(always)]
    pub fn continue_from(&mut self, offset: i32) {
        self.offset = offset;
    }

    /// Returns true if the output is at mid-scale and the ramp at its lower end, so that the voices can be exchanged.
    pub fn is_at_rest(&self) -> bool {
        self.offset == 0 && self.ramp.is_down()
    }

    /// Numbers of samples changed.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Modelled temperature rise of the coil, per mille of the steady rise at the power limit.
    pub fn thermal_load_permille(&self) -> u16 {
        self.coil.load_permille()
    }

    /// Gain of the thermal limiter, per mille.
    pub fn thermal_gain_permille(&self) -> u16 {
        self.coil.gain_permille()
    }
}

impl Counters {
    #[inline(always)]
    fn count(&mut self, hard: bool, slew: bool, thermal: bool) {
        self.hard_limited = self.hard_limited.saturating_add(u32::from(hard));
        self.slew_limited = self.slew_limited.saturating_add(u32::from(slew));
        self.thermally_limited = self.thermally_limited.saturating_add(u32::from(thermal));
    }
}
