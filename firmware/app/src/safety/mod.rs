//! Safety stages between a sample of the kernel and the codes for the converter, so that no sample can harm the coil or
//! the hand.
//!
//! ```text
//! each sample OutputSample -> gain -> DC blocker -> mute ramp -> thermal limiter -> interpolator
//!                                                                      ^                 |
//!                                                                  coil model            v 8 per tick
//!                                                                      |                 |
//! each code                             DacCode <- slew limit <- hard limit <- noise shaper
//! ```
//! Between the stages a value has 16 binary digits below a converter step, and 15 after the interpolator. Only the
//! noise shaper rounds to whole steps. The limits come last, so they hold for every code. The coil's model is driven by
//! the codes that are put out, not by the thermal limiter's output.
//!
//! The ramp comes after the DC blocker, so that a muted output is at exactly mid-scale when the ramp has ended and the
//! interpolator is empty, without the blocker's tail.
//!
//! A tick has one sample at 5 kHz and two at 10 kHz. The filter constant of the DC blocker, the steps of the ramp, and
//! the filters of the interpolator depend on the rate. The coil's model works per tick and the limits per code, at the
//! same times at both rates.
//!
//! A sample is processed in integer arithmetic, along the same path whatever its value. [`Config`] is computed from
//! settings, in floating-point operations that IEEE 754 defines to the last bit, so that host and device put out the
//! same codes.
//!
//! The units of the stages, and the ramp of soft start and mute, are here.

mod interpolator;
mod limits;
mod shaper;
mod thermal;

use interpolator::Interpolator;
use limits::{Cut, LimitConfig, Pin};
use model_format::link::{OutputLimits, Setting, Settings};
use model_format::{DacCode, OutputSample, PlayRate};
use shaper::Shaper;
use stylus_kernel::dc_blocker::{self, DcBlocker};
use stylus_kernel::fixed::shift_toward_zero;
use thermal::{CoilConfig, CoilState};

use crate::SAMPLE_RATE_HZ;

pub use thermal::{Heat, MOST_HELD_TICKS, PEAK_POWER_RATIO};

/// Binary digits after the point of the gain.
const GAIN_BITS: u32 = 20;

/// Largest magnitude of the input of the stages after the gain: half the converter's range, in 2^-16 steps.
const FULL_SCALE: i64 = 2048 << STEP_BITS;

/// Configuration of the safety stages, computed when settings or the played texture change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Gain from the kernel's output to converter steps of 2^-16, in units of 2^-20.
    gain: i32,
    ramp: RampConfig,
    coil: CoilConfig,
    limits: LimitConfig,
    rate: PlayRate,
}

impl Config {
    /// The configuration by `settings` for playing 5 kHz at `play_gain`, which must be finite and not negative.
    pub fn new(settings: &Settings, play_gain: f32) -> Self {
        Self::at_rate(settings, play_gain, PlayRate::Hz5000)
    }

    /// Like [`Config::new`], for playing at `rate`. The rate may change only while the output is at rest.
    pub fn at_rate(settings: &Settings, play_gain: f32, rate: PlayRate) -> Self {
        let per_step = 1.0 / DacCode::STEP.0;
        let steps_per_acceleration = settings.get(Setting::OutputGain) * play_gain * per_step;
        // From 2^-20 m/s² to 2^-16 steps is a division by 2^4.
        let scale = (1u32 << (GAIN_BITS - OutputSample::FRACTION_BITS + STEP_BITS)) as f32;
        let coil = CoilConfig::new(settings);
        Self {
            // The conversion of a float saturates.
            gain: (steps_per_acceleration * scale) as i32,
            ramp: RampConfig::new(settings, rate),
            coil,
            limits: LimitConfig::new(settings, coil.peak_limit()),
            rate,
        }
    }

    /// Returns the limits of the output under `settings`, from which this configuration was computed.
    pub fn output_limits(&self, settings: &Settings) -> OutputLimits {
        thermal::limits(settings, self.limits.offset)
    }

    /// Heat that is assumed for a coil about which nothing is known: the largest heat without attenuation.
    ///
    /// After power-on nothing is known. A coil at its limit is warmer than assumed by a quarter of the limit. Each
    /// power cycle can therefore add an energy above the limit, in J, of a quarter of the power limit times the time
    /// constant. If more heat were assumed, a cold stylus would be attenuated at each start.
    pub fn assumed_heat(&self) -> Heat {
        self.coil.knee()
    }

    /// The rate of the samples.
    #[inline(always)]
    pub fn rate(&self) -> PlayRate {
        self.rate
    }

    /// Largest offset of the output from mid-scale, converter steps: the lower of the hard limit and the limit by
    /// [`PEAK_POWER_RATIO`].
    pub fn limit_steps(&self) -> i32 {
        self.limits.offset
    }

    /// Largest change from one code to the next, converter steps.
    pub fn slew_steps(&self) -> i32 {
        self.limits.slew
    }

    /// Largest number of ticks from any output to exactly mid-scale after a mute: the ramp, the interpolator's length,
    /// and the slew limit's lag.
    pub fn mute_ticks(&self) -> u32 {
        let ramp = (self.ramp.down_samples()).div_ceil(self.rate.samples_per_tick());
        let apart = shaper::LARGEST_DEVIATION;
        let peak = interpolator::LARGEST_OUTPUT + apart;
        ramp + interpolator::TICKS + self.limits.lag_ticks(ramp, peak, apart)
    }
}

/// The signal of a tick, before the stages that act on codes.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Converter steps of 2^-15.
    codes: [i32; OVERSAMPLING],
    /// True if the thermal limiter attenuated.
    attenuated: bool,
}

/// State and counters of the safety stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    dc_blocker: DcBlocker,
    ramp: Ramp,
    coil: CoilState,
    interpolator: Interpolator,
    shaper: Shaper,
    pin: Pin,
    /// Energy of the ticks that were missed since the last codes. Their codes were not computed by this state.
    held: u32,
    counters: Counters,
}

/// Numbers of ticks at which the safety stages changed the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Ticks with a code that the hard limit cut.
    pub hard_limited: u32,
    /// Ticks with a code that the slew limit held back.
    pub slew_limited: u32,
    /// Ticks at which the thermal limiter attenuated.
    pub thermally_limited: u32,
}

impl State {
    /// State at mid-scale and muted, of a coil about which nothing is known: see [`Config::assumed_heat`].
    pub fn new(config: &Config) -> Self {
        Self::with_heat(config.assumed_heat())
    }

    /// State at mid-scale and muted, of a coil that is as warm as `heat`.
    pub const fn with_heat(heat: Heat) -> Self {
        Self {
            dc_blocker: DcBlocker::new(),
            ramp: Ramp::new(),
            coil: CoilState::new(heat),
            interpolator: Interpolator::new(),
            shaper: Shaper::new(),
            pin: Pin::at(0),
            held: 0,
            counters: Counters {
                hard_limited: 0,
                slew_limited: 0,
                thermally_limited: 0,
            },
        }
    }

    /// The codes of a tick at 5 kHz: [`State::wanted`], then [`State::codes`].
    #[inline(always)]
    pub fn process(&mut self, config: &Config, sample: OutputSample, muted: bool) -> [DacCode; OVERSAMPLING] {
        let wanted = self.wanted(config, sample, muted);
        self.codes(config, wanted)
    }

    /// The codes of a tick at 10 kHz: [`State::wanted_of_pair`], then [`State::codes`].
    #[inline(always)]
    pub fn process_pair(
        &mut self,
        config: &Config,
        samples: [OutputSample; 2],
        muted: bool,
    ) -> [DacCode; OVERSAMPLING] {
        let wanted = self.wanted_of_pair(config, samples, muted);
        self.codes(config, wanted)
    }

    /// The signal of a tick at 5 kHz, before the stages that act on codes.
    ///
    /// While `muted`, the signal goes to zero along the mute ramp and stays there. Afterwards it returns along the soft
    /// start.
    #[inline(always)]
    pub fn wanted(&mut self, config: &Config, sample: OutputSample, muted: bool) -> Wanted {
        let (cooled, attenuated) = self.cooled::<{ dc_blocker::ALPHA }>(config, sample, muted);
        Wanted {
            codes: self.interpolator.next(cooled),
            attenuated,
        }
    }

    /// Like [`State::wanted`], for the two samples of a tick at 10 kHz.
    #[inline(always)]
    pub fn wanted_of_pair(&mut self, config: &Config, samples: [OutputSample; 2], muted: bool) -> Wanted {
        let mut attenuated = false;
        let inputs = samples.map(|sample| {
            let (cooled, less) = self.cooled::<{ dc_blocker::ALPHA_OF_PAIR }>(config, sample, muted);
            attenuated |= less;
            cooled
        });
        Wanted {
            codes: self.interpolator.next_of_pair(inputs),
            attenuated,
        }
    }

    /// The interpolator's input for `sample`, and true if the thermal limiter attenuated it.
    #[inline(always)]
    fn cooled<const ALPHA: i64>(&mut self, config: &Config, sample: OutputSample, muted: bool) -> (i32, bool) {
        // The clamp is the bound by which no sum of the stages after it overflows; the hard limit comes later.
        let product = i64::from(sample.0) * i64::from(config.gain);
        let amplified = shift_toward_zero(product, GAIN_BITS).clamp(-FULL_SCALE, FULL_SCALE);
        let without_dc = self.dc_blocker.next::<ALPHA>(amplified);
        let ramped = self.ramp.next(config.ramp, without_dc, muted);
        let (cooled, attenuated) = self.coil.attenuate(config.coil, ramped);
        (cooled as i32, attenuated)
    }

    /// The next codes for the converter, in the order in which they are put out.
    #[inline(always)]
    pub fn codes(&mut self, config: &Config, wanted: Wanted) -> [DacCode; OVERSAMPLING] {
        let Wanted {
            codes: wanted,
            attenuated,
        } = wanted;
        self.shaper.forget_if(self.interpolator.is_empty());
        let mut pin = self.pin.under(config.limits);
        // Missed ticks warm the coil with this tick's energy, so that the heat is updated once per tick that runs.
        let (mut energy, mut cut) = (core::mem::take(&mut self.held), Cut::default());
        let codes = wanted.map(|wanted| {
            let requested = self.shaper.next(wanted);
            let offset = pin.next(config.limits, requested, &mut cut);
            energy += offset.unsigned_abs().pow(2);
            DacCode::from_mid_scale(offset)
        });
        self.pin = pin;
        self.coil.follow(config.coil, energy);
        self.counters.count(cut.is_hard(), cut.is_slew(), attenuated);
        codes
    }

    /// Adds the heat of `ticks` that were missed, during which the output held and then faded its last code.
    #[inline(always)]
    pub fn miss(&mut self, ticks: u32) {
        self.held = thermal::held_energy(self.pin.offset(), ticks);
    }

    /// Makes the next codes continue from a code at `offset` steps from mid-scale, which is put out just before them.
    ///
    /// After a late tick, this is not the code that was computed last. The slew limit must hold at the pin.
    #[inline(always)]
    pub fn continue_from(&mut self, offset: i32) {
        self.pin = Pin::at(offset);
    }

    /// Returns true if the output is at mid-scale and stays there, because the ramp is at its lower end and the
    /// interpolator is empty. The voices can be exchanged then.
    pub fn is_at_rest(&self) -> bool {
        self.pin.is_mid_scale() && self.interpolator.is_empty() && self.ramp.is_down()
    }

    /// Numbers of ticks at which the signal was changed.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Heat of the coil.
    pub fn heat(&self) -> Heat {
        self.coil.heat()
    }

    /// Replaces the heat of the coil, at the start.
    pub fn set_heat(&mut self, heat: Heat) {
        self.coil = CoilState::new(heat);
    }

    /// Modelled temperature rise of the coil, per mille of the steady rise at the power limit.
    pub fn thermal_load_permille(&self, config: &Config) -> u16 {
        self.coil.load_permille(config.coil)
    }

    /// Gain of the thermal limiter, per mille.
    pub fn thermal_gain_permille(&self, config: &Config) -> u16 {
        self.coil.gain_permille(config.coil)
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

/// Number of codes for the converter per tick. They are put out at equal intervals.
pub const OVERSAMPLING: usize = 8;

/// Codes per second at the pin.
pub const PIN_RATE_HZ: u32 = SAMPLE_RATE_HZ * OVERSAMPLING as u32;

/// Binary digits after the point of the values between the stages of a tick, which are in converter steps of 2^-16.
const STEP_BITS: u32 = 16;

/// Binary digits after the point of the interpolator's outputs.
const CODE_BITS: u32 = 15;

/// The nearest whole step, for a `value` in 2^-[`CODE_BITS`] that is at most 2^30.
#[inline(always)]
fn round_to_step(value: i32) -> i32 {
    (value + (1 << (CODE_BITS - 1))) >> CODE_BITS
}

/// `value` limited to `low`..=`high`, where `high` is not below `low`. Unlike `clamp` it has no branch that panics.
#[inline(always)]
fn within(value: i32, low: i32, high: i32) -> i32 {
    value.max(low).min(high)
}

/// A gain of one, of the ramp.
const RAMP_ONE: i32 = 1 << 30;
const RAMP_BITS: u32 = 30;

/// Soft start and mute: a gain that goes in equal steps between exactly zero and exactly one. Steps of the gain per
/// sample, up and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct RampConfig {
    up: i32,
    down: i32,
}

impl RampConfig {
    fn new(settings: &Settings, rate: PlayRate) -> Self {
        let step = |setting| {
            // Rounded up, so that a ramp takes no longer than its setting.
            let samples = settings.get(setting) * rate.hz() as f32 / 1e3;
            (RAMP_ONE as f32 / samples) as i32 + 1
        };
        Self {
            up: step(Setting::SoftStart),
            down: step(Setting::MuteRamp),
        }
    }

    /// Number of samples from one to zero.
    fn down_samples(self) -> u32 {
        (RAMP_ONE as u32).div_ceil(self.down as u32)
    }
}

/// The present gain of the ramp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Ramp {
    gain: i32,
}

impl Ramp {
    const fn new() -> Self {
        Self { gain: 0 }
    }

    /// `input` times the gain, which first goes a step down if `muted`, and up otherwise.
    #[inline(always)]
    fn next(&mut self, config: RampConfig, input: i64, muted: bool) -> i64 {
        let step = if muted { -config.down } else { config.up };
        // A step is at most a fifth, so the sum does not overflow.
        self.gain = (self.gain + step).clamp(0, RAMP_ONE);
        shift_toward_zero(input * i64::from(self.gain), RAMP_BITS)
    }

    /// Returns true if the gain is exactly zero.
    fn is_down(self) -> bool {
        self.gain == 0
    }
}
