//! Units of the stages: codes per tick, and converter steps in fixed point with rounding that adds neither energy nor
//! a bias.

use crate::SAMPLE_RATE_HZ;

/// Number of codes for the converter per tick. They are put out at equal intervals.
pub const OVERSAMPLING: usize = 8;

/// Codes per second at the pin.
pub const PIN_RATE_HZ: u32 = SAMPLE_RATE_HZ * OVERSAMPLING as u32;

/// Binary digits after the point of the values between the stages of a tick, which are in converter steps of 2^-16.
pub const STEP_BITS: u32 = 16;

/// Binary digits after the point of the interpolator's outputs.
pub const CODE_BITS: u32 = 15;

/// The nearest whole step, for a `value` in 2^-[`CODE_BITS`] that is at most 2^30.
#[inline(always)]
pub fn round_to_step(value: i32) -> i32 {
    (value + (1 << (CODE_BITS - 1))) >> CODE_BITS
}

/// `value` limited to `low`..=`high`, where `high` is not below `low`. Unlike `clamp` it has no branch that panics.
#[inline(always)]
pub fn within(value: i32, low: i32, high: i32) -> i32 {
    value.max(low).min(high)
}
