//! Soft start and mute: a gain that goes in equal steps between exactly zero and exactly one.

use model_format::PlayRate;
use model_format::link::{Setting, Settings};
use stylus_kernel::fixed::shift_toward_zero;

/// A gain of one.
const ONE: i32 = 1 << 30;
const ONE_BITS: u32 = 30;

/// Steps of the gain per sample, up and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RampConfig {
    up: i32,
    down: i32,
}

impl RampConfig {
    pub fn new(settings: &Settings, rate: PlayRate) -> Self {
        let step = |setting| {
            // Rounded up, so that a ramp takes no longer than its setting.
            let samples = settings.get(setting) * rate.hz() as f32 / 1e3;
            (ONE as f32 / samples) as i32 + 1
        };
        Self {
            up: step(Setting::SoftStart),
            down: step(Setting::MuteRamp),
        }
    }

    /// Number of samples from one to zero.
    pub fn down_samples(self) -> u32 {
        (ONE as u32).div_ceil(self.down as u32)
    }
}

/// The present gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ramp {
    gain: i32,
}

impl Ramp {
    pub const fn new() -> Self {
        Self { gain: 0 }
    }

    /// `input` times the gain, which first goes a step down if `muted`, and up otherwise.
    #[inline(always)]
    pub fn next(&mut self, config: RampConfig, input: i64, muted: bool) -> i64 {
        let step = if muted { -config.down } else { config.up };
        // A step is at most a fifth, so the sum does not overflow.
        self.gain = (self.gain + step).clamp(0, ONE);
        shift_toward_zero(input * i64::from(self.gain), ONE_BITS)
    }

    /// Returns true if the gain is exactly zero.
    pub fn is_down(self) -> bool {
        self.gain == 0
    }
}
