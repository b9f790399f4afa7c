//! How warm the coil is, and a gain that falls before it is too warm.
//!
//! The coil is one thermal mass: its rise T above the surroundings, in units of the rise that the power limit leads to in
//! the end, follows τ dT/dt = P / P_limit - T with P = (a V)² / R, where V is the voltage at the converter, from mid-scale, and a
//! the amplifier's gain. The impedance is taken as R alone, which never counts too little.
//!
//! Below [`KNEE`] nothing is done; from there to one the gain falls in proportion to nothing. A voltage is never above
//! what leads to [`PEAK_POWER_RATIO`] times the power limit, so that T cannot run past one while the slew limit lets the output
//! down: with the ranges that settings have it stays below 1.1.

use model_format::DacCode;
use model_format::link::{Setting, Settings};

use super::fixed::shift_toward_zero;
use crate::SAMPLE_RATE_HZ;

/// Largest power for a moment, in units of the power limit: a Gaussian signal at the limit is cut at four times its RMS.
pub const PEAK_POWER_RATIO: f32 = 16.0;

/// Binary digits of the rise.
const RISE_BITS: u32 = 48;
const ONE: i64 = 1 << RISE_BITS;
/// Where attenuation begins.
const KNEE: i64 = ONE / 4 * 3;

/// Binary digits of the gain.
const GAIN_BITS: u32 = 16;
const FULL_GAIN: i64 = 1 << GAIN_BITS;

/// Binary digits of the leak's share a sample.
const LEAK_BITS: u32 = 40;
/// Digits of the rise that the leak is computed without, so that 64 bits hold the product.
const COARSE_BITS: u32 = 18;

/// How the coil warms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilConfig {
    /// Rise in a sample, in 2^-48, for an output of one converter step; it goes with the square.
    warming: i64,
    /// Share of the rise that is lost in a sample, in 2^-40.
    leak: i64,
    /// Largest offset from mid-scale, converter steps, that stays below the peak power.
    peak: i32,
}

impl CoilConfig {
    pub fn new(settings: &Settings) -> Self {
        let seconds = settings.get(Setting::ThermalTimeConstant);
        let share = 1.0 / (seconds * SAMPLE_RATE_HZ as f32);
        let volt = DacCode::STEP.0 * settings.get(Setting::AmplifierGain);
        let limit = settings.get(Setting::CoilResistance) * settings.get(Setting::PowerLimit);
        // Power of one step in units of the limit.
        let power = volt * volt / limit;
        // Conversions of floats saturate: a step that is far too strong leaves a peak of 0 and never comes out.
        let peak = ((PEAK_POWER_RATIO / power) as u64).isqrt().min(2048) as i32;
        Self {
            // Rounded up, to count too much rather than too little. 2^40 times 2048² is below 2^63.
            warming: ((power * share * ONE as f32) as i64 + 1).min(1 << 40),
            leak: (share * (1u64 << LEAK_BITS) as f32) as i64,
            peak,
        }
    }

    pub fn peak_limit(self) -> i32 {
        self.peak
    }
}

/// The coil's warmth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilState {
    /// In 2^-48 of the rise that the power limit leads to.
    rise: i64,
}

impl CoilState {
    /// As warm as can be without attenuation.
    pub const fn new() -> Self {
        Self { rise: KNEE }
    }

    #[inline(always)]
    fn gain(self) -> i64 {
        // (1 - T) / (1 - knee), of which the knee makes four times.
        ((ONE - self.rise) >> (RISE_BITS - GAIN_BITS - 2)).clamp(0, FULL_GAIN)
    }

    /// `input` times the gain, and whether that was less than one.
    #[inline(always)]
    pub fn attenuate(self, input: i64) -> (i64, bool) {
        let gain = self.gain();
        (shift_toward_zero(input * gain, GAIN_BITS), gain < FULL_GAIN)
    }

    /// Takes account of an output of `offset` converter steps for one sample.
    #[inline(always)]
    pub fn follow(&mut self, config: CoilConfig, offset: i32) {
        let warming = config.warming * i64::from(offset * offset);
        let leak = ((self.rise >> COARSE_BITS) * config.leak) >> (LEAK_BITS - COARSE_BITS);
        self.rise = (self.rise - leak).saturating_add(warming);
    }

    /// 1000 is what the power limit leads to.
    pub fn load_permille(self) -> u16 {
        (((self.rise >> COARSE_BITS) * 1000) >> (RISE_BITS - COARSE_BITS))
            .clamp(0, i64::from(u16::MAX)) as u16
    }

    /// 1000 is no attenuation.
    pub fn gain_permille(self) -> u16 {
        ((self.gain() * 1000) >> GAIN_BITS) as u16
    }
}
