//! Tap transients: a two-pole resonator, computed as a damped rotation.
//!
//! The state is a vector (c, s). Each sample rotates it by the frequency's angle and shortens it by the decay; s is the
//! output. The rotation's cos² + sin² is at most 2⁶² in the integers, and products are truncated toward zero, so that
//! the vector never lengthens and a ringing tap decays to exact zero, like in [`crate::lattice`].
//!
//! A strike adds to c and leaves s unchanged, so that the transient begins at 0, in sine phase. It adds only so much
//! that the 1-norm of (c, s) stays within the limit: **the norm of the state is never above the larger of the limit and
//! its former value**, however often the tool strikes. Frequency and decay may change while the tap rings, because
//! every rotation keeps the bound.

use model_format::OutputSample;
use model_format::scene::Tap;

use crate::fixed::{high_word_toward_zero, shift_toward_zero};
use crate::rotation::{Rotation, THETA_QUARTER_TURN};

/// Binary digits after the point that the state has in addition to those of an output sample.
const GUARD_BITS: u32 = 2;

/// The rotation of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resonance {
    /// r · cos θ in steps of 2⁻³¹.
    cos: i32,
    /// r · sin θ in steps of 2⁻³¹.
    sin: i32,
}

/// An impact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strike {
    amplitude: i32,
    limit: i32,
}

/// State of a tap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TapState {
    cosine: i32,
    sine: i32,
}

impl Resonance {
    /// The resonance of `tap` at `sample_rate_hz`.
    pub fn new(tap: &Tap, sample_rate_hz: u32) -> Self {
        let rate = f64::from(sample_rate_hz);
        // Half the sample rate is half a turn, two quarter turns; the frequency is below half the sample rate.
        let theta = f64::from(tap.frequency_hz) / rate * 4.0 * f64::from(THETA_QUARTER_TURN);
        let theta = theta as i32;
        // A rotation covers a quarter turn. Beyond it the angle is mirrored, and the cosine negated.
        let beyond_quarter = theta > THETA_QUARTER_TURN;
        let rotation = Rotation::from_theta(if beyond_quarter {
            2 * THETA_QUARTER_TURN - theta
        } else {
            theta
        });
        let cos = if beyond_quarter { -rotation.cos } else { rotation.cos };
        let radius = libm::exp(-1.0 / (f64::from(tap.decay_s) * rate));
        let radius = (radius * (1u64 << 31) as f64) as i64;
        let damped = |value: i32| shift_toward_zero(i64::from(value) * radius, 31) as i32;
        Self {
            cos: damped(cos),
            sin: damped(rotation.sin),
        }
    }
}

impl Strike {
    /// The strike of `tap` by an impact whose force rises by `newton_per_second`.
    pub fn new(tap: &Tap, newton_per_second: f32) -> Self {
        let limit = steps(tap.limit_m_s2);
        let amplitude = steps((tap.gain_m_s2_per_n_s * newton_per_second).max(0.0));
        Self {
            amplitude: amplitude.min(limit),
            limit,
        }
    }

    /// Returns whether the strike has no amplitude.
    pub fn is_silent(&self) -> bool {
        self.amplitude == 0
    }
}

/// An acceleration in steps of the state. Values beyond `i32` saturate; no limit reaches them.
fn steps(m_s2: f32) -> i32 {
    (m_s2 * (1u32 << (OutputSample::FRACTION_BITS + GUARD_BITS)) as f32) as i32
}

impl TapState {
    /// Silence.
    pub const fn new() -> Self {
        Self { cosine: 0, sine: 0 }
    }

    /// Applies a strike. The next sample continues from the last one.
    #[inline(always)]
    pub fn strike(&mut self, strike: Strike) {
        let room = strike.limit - self.sine.abs();
        let wanted = self.cosine + strike.amplitude;
        // If the state is beyond the limit already, as after a change of tap, the strike adds nothing.
        self.cosine = wanted.min(self.cosine.max(room));
    }

    /// The next sample.
    #[inline(always)]
    pub fn next_sample(&mut self, resonance: Resonance) -> OutputSample {
        let (cos, sin) = (i64::from(resonance.cos), i64::from(resonance.sin));
        let (c, s) = (i64::from(self.cosine), i64::from(self.sine));
        let output = shift_toward_zero(s, GUARD_BITS);
        // No vector is longer than 2³⁰, so that no sum overflows and doubling does not saturate.
        self.cosine = 2 * high_word_toward_zero(cos * c - sin * s);
        self.sine = 2 * high_word_toward_zero(sin * c + cos * s);
        OutputSample(output as i32)
    }

    /// Returns whether the state is zero, so that the output is zero until the next strike.
    pub fn is_silent(&self) -> bool {
        self.cosine | self.sine == 0
    }

    /// The square of the state's norm, in steps of 2⁻²² m/s².
    pub fn square_norm(&self) -> u64 {
        let square = |x: i32| u64::from(x.unsigned_abs()).pow(2);
        square(self.cosine) + square(self.sine)
    }
}
