//! Hard limit and slew limit of each code.

use model_format::DacCode;
use model_format::link::{Setting, Settings};

use super::{OVERSAMPLING, PIN_RATE_HZ, within};

/// Limits of the codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimitConfig {
    /// Largest offset from mid-scale, converter steps, not negative.
    pub offset: i32,
    /// Largest change from one code to the next, converter steps, at least one.
    pub slew: i32,
}

impl LimitConfig {
    /// The limits by `settings`, with no offset beyond `peak`.
    pub fn new(settings: &Settings, peak: i32) -> Self {
        let per_step = 1.0 / DacCode::STEP.0;
        let slew_per_code = settings.get(Setting::SlewLimit) * 1e3 / PIN_RATE_HZ as f32;
        // Rounded down, so that no code exceeds the settings. The slew limit is at least one step, or the output could
        // not even go to mid-scale.
        Self {
            offset: ((settings.hard_limit().0 * per_step) as i32).min(peak),
            slew: ((slew_per_code * per_step) as i32).max(1),
        }
    }

    /// Returns the most ticks that the slew limit needs to reach mid-scale after the end of a mute ramp of
    /// `ramp_ticks`. Before the ramp the signal is at most `peak` steps, and during it at most `apart` steps more than
    /// the ramp allows.
    ///
    /// While the ramp is still above the hard limit, the output stays at that limit. It lags most if the slew limit
    /// holds it back from the instant at which the ramp passes the hard limit.
    pub fn lag_ticks(self, ramp_ticks: u32, peak: i32, apart: i32) -> u32 {
        let (limit, peak) = (i64::from(self.offset), i64::from(peak.max(1)));
        let per_tick = i64::from(self.slew) * OVERSAMPLING as i64;
        let below_the_limit = i64::from(ramp_ticks) * limit.min(peak) / peak;
        let lag = (limit - per_tick * below_the_limit).max(0) + i64::from(apart);
        (lag as u64).div_ceil(per_tick as u64) as u32
    }
}

/// The last code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Offset of the code from mid-scale, converter steps.
    offset: i32,
}

/// Changes that the limits made to codes: zero for none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cut {
    hard: i32,
    slew: i32,
}

impl Cut {
    /// True if the hard limit cut a code.
    pub fn is_hard(self) -> bool {
        self.hard != 0
    }

    /// True if the slew limit held a code back.
    pub fn is_slew(self) -> bool {
        self.slew != 0
    }
}

impl Pin {
    /// A code at `offset` converter steps from mid-scale.
    pub const fn at(offset: i32) -> Self {
        Self { offset }
    }

    /// Offset of the code from mid-scale, converter steps.
    #[inline(always)]
    pub fn offset(self) -> i32 {
        self.offset
    }

    /// The last code, within limits that may have changed since.
    #[inline(always)]
    pub fn under(self, limits: LimitConfig) -> Self {
        Self {
            offset: within(self.offset, -limits.offset, limits.offset),
        }
    }

    /// Returns the offset of the next code: the nearest to `requested` within the limits. The last code must be within
    /// them, too.
    #[inline(always)]
    pub fn next(&mut self, limits: LimitConfig, requested: i32, cut: &mut Cut) -> i32 {
        let limited = within(requested, -limits.offset, limits.offset);
        let (low, high) = (self.offset - limits.slew, self.offset + limits.slew);
        self.offset = within(limited, low, high);
        // Differing bits are collected in place of conditions: the path does not depend on the codes.
        cut.hard |= requested ^ limited;
        cut.slew |= limited ^ self.offset;
        self.offset
    }

    pub fn is_mid_scale(self) -> bool {
        self.offset == 0
    }
}
