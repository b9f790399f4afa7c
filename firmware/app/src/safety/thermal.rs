//! Thermal model of the coil, and a gain that falls before the coil is too warm.
//!
//! The coil is one thermal mass. Its rise T above the surroundings, in units of the steady rise at the power limit,
//! follows τ dT/dt = P / P_limit - T with P = (a V)² / R, where V is the voltage at the converter, from mid-scale, and
//! a the amplifier's gain. The impedance is taken as R only, which never underestimates the power.
//!
//! **The state is only the mean of V²** over the time constant, because that is all that the device knows by itself.
//! Resistance, gain and power limit serve for comparison: T is the ratio of this mean to the mean square that the limit
//! allows. A change of settings therefore neither cools the coil nor overflows anything; it changes T at once. The
//! allowed mean of V² is at most [`MAX_PIN_MEAN_SQUARE`], whatever the settings of coil and amplifier are.
//!
//! Up to T = 3/4 the gain is one; from there it falls linearly to zero at T = 1. The voltage never exceeds the one at
//! [`PEAK_POWER_RATIO`] times the power limit, so that T cannot rise far above one while the slew limit lets the output
//! fall. Within the ranges of the settings T stays below 1.1.

use model_format::DacCode;
use model_format::link::{MAX_PIN_MEAN_SQUARE, OutputLimits, Setting, Settings};
use stylus_kernel::fixed::shift_toward_zero;

use super::OVERSAMPLING;
use crate::SAMPLE_RATE_HZ;

/// Largest instantaneous power, in units of the power limit: a Gaussian signal at the limit is cut at four times its
/// RMS.
pub const PEAK_POWER_RATIO: f32 = 16.0;

/// Binary digits of the heat after the point.
const HEAT_BITS: u32 = 30;
/// Largest heat: that of a full-scale output forever.
const MOST_HEAT: i64 = 1 << (22 + HEAT_BITS);

/// Lower binary digits of heat and limit that the gain ignores, so that its product fits in 64 bits.
const GAIN_COARSE_BITS: u32 = 8;
/// Smallest limit, so that the gain never divides by zero.
const LEAST_LIMIT: i64 = 1 << (2 * GAIN_COARSE_BITS);

/// Binary digits of the gain after the point.
const GAIN_BITS: u32 = 16;
const FULL_GAIN: i64 = 1 << GAIN_BITS;
/// Binary digits of [`CoilConfig::inverse`] beyond those of the gain, which is four times (1 - T).
const INVERSE_BITS: u32 = 33;

/// Binary digits after the point of [`CoilConfig::share`].
const SHARE_BITS: u32 = 38;
/// Lower binary digits of the heat that the leak ignores, so that its product fits in 64 bits.
const COARSE_BITS: u32 = 16;
/// Binary digits by which energy times share is shifted down to a heat. The energy is summed over [`OVERSAMPLING`]
/// codes.
const WARMING_BITS: u32 = SHARE_BITS - HEAT_BITS + OVERSAMPLING.ilog2();

/// Largest sum of the squared offsets of a tick's codes and of the codes in missed ticks before it.
const MOST_ENERGY: i64 = (1 + MOST_HELD_TICKS as i64) * OVERSAMPLING as i64 * (1 << 22);

/// Largest number of ticks for which the output holds or fades a code if no further tick follows. After these `ring` is
/// at mid-scale.
pub const MOST_HELD_TICKS: u32 = 3;

/// Shortest time constant, s.
const SHORTEST: i64 = Setting::ThermalTimeConstant.spec().lowest as i64;

const _: () = {
    let share = (1 << SHARE_BITS) / (SHORTEST * SAMPLE_RATE_HZ as i64) + 1;
    let warmest = MOST_HEAT + ((MOST_ENERGY * share) >> WARMING_BITS) + 1;
    assert!(
        OVERSAMPLING.is_power_of_two()
            && MOST_ENERGY <= u32::MAX as i64
            && i64::MAX / share > MOST_ENERGY + (1 << WARMING_BITS)
            && i64::MAX / share > warmest >> COARSE_BITS,
        "whatever the configuration was before, no sum or product of `follow` overflows"
    );
};

/// Thermal parameters of the coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilConfig {
    /// Fraction by which the heat approaches the power per tick, in 2^-38.
    share: i64,
    /// Heat at the power limit.
    limit: i64,
    /// Gain per unit of heat below the limit; see [`CoilState::gain`].
    inverse: i64,
    /// Largest offset from mid-scale that stays below the peak power, converter steps.
    peak: i32,
}

impl CoilConfig {
    pub fn new(settings: &Settings) -> Self {
        let per_tick = 1.0 / (settings.get(Setting::ThermalTimeConstant) * SAMPLE_RATE_HZ as f32);
        let square = told_mean_square(settings).min(MAX_PIN_MEAN_SQUARE);
        let steps = square / (DacCode::STEP.0 * DacCode::STEP.0);
        let limit = ((steps * (1u64 << HEAT_BITS) as f32) as i64).max(LEAST_LIMIT);
        Self {
            share: (per_tick * (1u64 << SHARE_BITS) as f32) as i64,
            limit,
            inverse: (1 << (GAIN_BITS + 2 + INVERSE_BITS)) / (limit >> GAIN_COARSE_BITS),
            // Conversions of floats saturate: if a single step is too strong, the peak is 0, and nothing is put out.
            peak: ((PEAK_POWER_RATIO * steps) as u64).isqrt().min(2048) as i32,
        }
    }

    /// Largest offset from mid-scale that stays below the peak power, converter steps.
    pub fn peak_limit(self) -> i32 {
        self.peak
    }

    /// Largest heat without attenuation.
    pub fn knee(self) -> Heat {
        // A thousandth of the limit less, so that no round-off attenuates.
        Heat(self.limit / 4 * 3 - self.limit / 1024)
    }
}

/// Mean square of the voltage at the pin at which the coil of `settings` has its power limit, V².
fn told_mean_square(settings: &Settings) -> f32 {
    let gain = settings.get(Setting::AmplifierGain);
    settings.get(Setting::CoilResistance) * settings.get(Setting::PowerLimit) / (gain * gain)
}

/// The limits by `settings` and by the caps. `offset` is the largest offset from mid-scale, converter steps.
pub fn limits(settings: &Settings, offset: i32) -> OutputLimits {
    let told = told_mean_square(settings);
    let mean_square = told.min(MAX_PIN_MEAN_SQUARE);
    let gain = settings.get(Setting::AmplifierGain);
    OutputLimits {
        peak_volt: offset as f32 * DacCode::STEP.0,
        mean_square,
        coil_watt: mean_square * gain * gain / settings.get(Setting::CoilResistance),
        is_capped: told > MAX_PIN_MEAN_SQUARE,
    }
}

/// Mean square of the pin's offset from mid-scale, over the coil's time constant. It determines the coil's warmth for
/// any coil and amplifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Heat(i64);

impl Heat {
    /// The heat as bits, to be kept over a reset.
    pub const fn to_bits(self) -> u64 {
        self.0.cast_unsigned()
    }

    /// The heat with these [`Heat::to_bits`]; none if no heat has them.
    pub const fn from_bits(bits: u64) -> Option<Self> {
        if bits <= MOST_HEAT.cast_unsigned() {
            Some(Self(bits.cast_signed()))
        } else {
            None
        }
    }
}

/// Warmth of the coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoilState {
    /// Heat in squares of converter steps, in 2^-30.
    heat: i64,
}

impl CoilState {
    pub const fn new(heat: Heat) -> Self {
        Self { heat: heat.0 }
    }

    pub const fn heat(self) -> Heat {
        Heat(self.heat)
    }

    #[inline(always)]
    fn gain(self, config: CoilConfig) -> i64 {
        // (1 - T) / (1 - knee) is four times (1 - T). The product is at most the numerator of the inverse.
        let room = (config.limit - self.heat).max(0) >> GAIN_COARSE_BITS;
        ((room * config.inverse) >> INVERSE_BITS).min(FULL_GAIN)
    }

    /// `input` times the gain, and true if the gain is below one.
    #[inline(always)]
    pub fn attenuate(self, config: CoilConfig, input: i64) -> (i64, bool) {
        let gain = self.gain(config);
        (shift_toward_zero(input * gain, GAIN_BITS), gain < FULL_GAIN)
    }

    /// Updates the heat by one tick. `energy` is the sum of the squared offsets of the tick's codes from mid-scale,
    /// converter steps². The heat is rounded up, so that it is never underestimated.
    #[inline(always)]
    pub fn follow(&mut self, config: CoilConfig, energy: u32) {
        let warming = (i64::from(energy) * config.share + ((1 << WARMING_BITS) - 1)) >> WARMING_BITS;
        let leak = ((self.heat >> COARSE_BITS) * config.share) >> (SHARE_BITS - COARSE_BITS);
        // The rounding up could exceed the largest heat, which `Heat::from_bits` would refuse after a reset.
        self.heat = (self.heat - leak + warming).min(MOST_HEAT);
    }

    /// The rise, per mille of the steady rise at the power limit.
    pub fn load_permille(self, config: CoilConfig) -> u16 {
        let load = (self.heat >> GAIN_COARSE_BITS) * 1000 / (config.limit >> GAIN_COARSE_BITS);
        load.clamp(0, i64::from(u16::MAX)) as u16
    }

    /// The gain, per mille.
    pub fn gain_permille(self, config: CoilConfig) -> u16 {
        ((self.gain(config) * 1000) >> GAIN_BITS) as u16
    }
}

/// Energy of `ticks` that were missed after a code of `offset`, while the output held and then faded that code.
#[inline(always)]
pub fn held_energy(offset: i32, ticks: u32) -> u32 {
    offset.unsigned_abs().pow(2) * (OVERSAMPLING as u32 * ticks.min(MOST_HELD_TICKS))
}
