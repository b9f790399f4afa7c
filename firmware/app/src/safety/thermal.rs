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

use super::fixed::shift_toward_zero;
use super::rate::{OVERSAMPLING, PIN_RATE_HZ};
use crate::SAMPLE_RATE_HZ;

/// Largest instantaneous power, in units of the power limit: a Gaussian signal at the limit is cut at four times its
/// RMS.
pub const PEAK_POWER_RATIO: f32 = 16.0;

/// Binary digits of the rise after the point.
const RISE_BITS: u32 = 48;
const ONE: i64 = 1 << RISE_BITS;
/// Largest rise that the model can hold, far above what the limits let it reach.
const HIGHEST: i64 = 32 * ONE;
/// Rise at which attenuation begins.
const KNEE: i64 = ONE / 4 * 3;

/// Binary digits of the gain after the point.
const GAIN_BITS: u32 = 16;
const FULL_GAIN: i64 = 1 << GAIN_BITS;

/// Binary digits of the leak per tick after the point.
const LEAK_BITS: u32 = 40;
/// Lower digits of the rise that the leak leaves out, so that 64 bits hold the product.
const COARSE_BITS: u32 = 18;

/// Largest rise per code and square of a step. A coil that is warmed more than 2^-11 by a single step is never driven,
/// because one step is more than its peak power.
const MOST_WARMING: i64 = 1 << 37;

/// Largest sum of the squares of the offsets of a tick's codes.
const MOST_ENERGY: i64 = OVERSAMPLING as i64 * (1 << 22);

/// Shortest time constant, s.
const SHORTEST: i64 = Setting::ThermalTimeConstant.spec().lowest as i64;

const _: () = {
    let leak = (1 << LEAK_BITS) / (SHORTEST * SAMPLE_RATE_HZ as i64);
    assert!(
        i64::MAX / (leak + 1) > HIGHEST >> COARSE_BITS
            && i64::MAX - HIGHEST > MOST_WARMING * MOST_ENERGY,
        "whatever the configuration was before, no sum or product of `follow` overflows"
    );
};

/// Thermal parameters of the coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilConfig {
    /// Rise per code, in 2^-48, for a code one converter step from mid-scale; it is proportional to the square of that
    /// offset. At most [`MOST_WARMING`].
    warming: i64,
    /// Share of the rise that is lost per tick, in 2^-40.
    leak: i64,
    /// Largest offset from mid-scale that stays below the peak power, converter steps.
    peak: i32,
}

impl CoilConfig {
    pub fn new(settings: &Settings) -> Self {
        let seconds = settings.get(Setting::ThermalTimeConstant);
        let per_code = 1.0 / (seconds * PIN_RATE_HZ as f32);
        let per_tick = 1.0 / (seconds * SAMPLE_RATE_HZ as f32);
        let volt = DacCode::STEP.0 * settings.get(Setting::AmplifierGain);
        let limit = settings.get(Setting::CoilResistance) * settings.get(Setting::PowerLimit);
        // Power of one step in units of the limit.
        let power = volt * volt / limit;
        // Conversions of floats saturate: if a single step is far too strong, the peak is 0, and nothing is put out.
        let peak = ((PEAK_POWER_RATIO / power) as u64).isqrt().min(2048) as i32;
        Self {
            // Rounded up, so as never to underestimate.
            warming: ((power * per_code * ONE as f32) as i64 + 1).min(MOST_WARMING),
            leak: (per_tick * (1u64 << LEAK_BITS) as f32) as i64,
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

    /// Updates the rise by one tick, of whose codes `energy` is the sum of the squares of the offsets from mid-scale,
    /// converter steps.
    #[inline(always)]
    pub fn follow(&mut self, config: CoilConfig, energy: u32) {
        let warming = config.warming * i64::from(energy);
        let leak = ((self.rise >> COARSE_BITS) * config.leak) >> (LEAK_BITS - COARSE_BITS);
        self.rise = (self.rise - leak + warming).min(HIGHEST);
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
