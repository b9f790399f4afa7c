//! Thermal model of the coil, and a gain that falls before the coil is too warm.
//!
//! The coil is one thermal mass. Its rise T above the surroundings, in units of the steady rise at the power limit,
//! follows τ dT/dt = P / P_limit - T with P = (a V)² / R, where V is the voltage at the converter, from mid-scale, and
//! a the amplifier's gain. The impedance is taken as R alone, which never underestimates the power.
//!
//! Below [`KNEE`] the gain is one; from there to T = 1 it falls linearly to zero. The voltage never exceeds the one
//! that gives [`PEAK_POWER_RATIO`] times the power limit, so that T cannot run far past one while the slew limit lets
//! the output fall: within the ranges of the settings it stays below 1.1.

use model_format::DacCode;
use model_format::link::{Setting, Settings};

use super::PIN_RATE_HZ;
use super::fixed::shift_toward_zero;

/// Largest instantaneous power, in units of the power limit: a Gaussian signal at the limit is cut at four times its
/// RMS.
pub const PEAK_POWER_RATIO: f32 = 16.0;

/// Binary digits of the rise after the point.
const RISE_BITS: u32 = 48;
const ONE: i64 = 1 << RISE_BITS;
/// Rise at which attenuation begins.
const KNEE: i64 = ONE / 4 * 3;

/// Binary digits of the gain after the point.
const GAIN_BITS: u32 = 16;
const FULL_GAIN: i64 = 1 << GAIN_BITS;

/// Binary digits of the leak per sample after the point.
const LEAK_BITS: u32 = 40;
/// Lower digits of the rise that the leak leaves out, so that 64 bits hold the product.
const COARSE_BITS: u32 = 18;

/// Thermal parameters of the coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilConfig {
    /// Rise per sample, in 2^-48, for an output of one converter step; it is proportional to the square of the output.
    warming: i64,
    /// Share of the rise that is lost per sample, in 2^-40.
    leak: i64,
    /// Largest offset from mid-scale that stays below the peak power, converter steps.
    peak: i32,
}

impl CoilConfig {
    pub fn new(settings: &Settings) -> Self {
        let seconds = settings.get(Setting::ThermalTimeConstant);
        let share = 1.0 / (seconds * PIN_RATE_HZ as f32);
        let volt = DacCode::STEP.0 * settings.get(Setting::AmplifierGain);
        let limit = settings.get(Setting::CoilResistance) * settings.get(Setting::PowerLimit);
        // Power of one step in units of the limit.
        let power = volt * volt / limit;
        // Conversions of floats saturate: if a single step is far too strong, the peak is 0, and nothing is put out.
        let peak = ((PEAK_POWER_RATIO / power) as u64).isqrt().min(2048) as i32;
        Self {
            // Rounded up, so as never to underestimate. 2^40 times 2048² is below 2^63.
            warming: ((power * share * ONE as f32) as i64 + 1).min(1 << 40),
            leak: (share * (1u64 << LEAK_BITS) as f32) as i64,
            peak,
        }
    }

    pub fn peak_limit(self) -> i32 {
        self.peak
    }
}

/// Temperature rise of the coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilState {
    /// Rise, in 2^-48 of the steady rise at the power limit.
    rise: i64,
}

impl CoilState {
    /// The largest rise without attenuation.
    pub const fn new() -> Self {
        Self { rise: KNEE }
    }

    #[inline(always)]
    fn gain(self) -> i64 {
        // (1 - T) / (1 - knee) is four times (1 - T).
        ((ONE - self.rise) >> (RISE_BITS - GAIN_BITS - 2)).clamp(0, FULL_GAIN)
    }

    /// `input` times the gain, and true if the gain is below one.
    #[inline(always)]
    pub fn attenuate(self, input: i64) -> (i64, bool) {
        let gain = self.gain();
        (shift_toward_zero(input * gain, GAIN_BITS), gain < FULL_GAIN)
    }

    /// Updates the rise by one sample of output at `offset` converter steps.
    #[inline(always)]
    pub fn follow(&mut self, config: CoilConfig, offset: i32) {
        let warming = config.warming * i64::from(offset * offset);
        let leak = ((self.rise >> COARSE_BITS) * config.leak) >> (LEAK_BITS - COARSE_BITS);
        self.rise = (self.rise - leak).saturating_add(warming);
    }

    /// The rise, per mille of the steady rise at the power limit.
    pub fn load_permille(self) -> u16 {
        (((self.rise >> COARSE_BITS) * 1000) >> (RISE_BITS - COARSE_BITS))
            .clamp(0, i64::from(u16::MAX)) as u16
    }

    /// The gain, per mille.
    pub fn gain_permille(self) -> u16 {
        ((self.gain() * 1000) >> GAIN_BITS) as u16
    }
}
