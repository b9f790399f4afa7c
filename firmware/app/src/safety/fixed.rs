//! Converter steps in fixed point, and rounding that adds neither energy nor a bias.

/// Binary digits after the point of the values between the stages, which are in converter steps of 2^-16.
pub const STEP_BITS: u32 = 16;

/// `value` / 2^`bits`, truncated toward zero, for `bits` below 63.
#[inline(always)]
pub fn shift_toward_zero(value: i64, bits: u32) -> i64 {
    let below_one = (1i64 << bits) - 1;
    (value + ((value >> 63) & below_one)) >> bits
}

/// The nearest whole step; `value` is at most twice the converter's range.
#[inline(always)]
pub fn round_to_step(value: i64) -> i32 {
    ((value + (1 << (STEP_BITS - 1))) >> STEP_BITS) as i32
}

/// `value`, or the nearer of `low` and `high`, which is not below `low`. Unlike `clamp` it has no branch that panics.
#[inline(always)]
pub fn within(value: i32, low: i32, high: i32) -> i32 {
    value.max(low).min(high)
}
