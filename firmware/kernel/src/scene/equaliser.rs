//! The actuator's equaliser: a cascade of second-order sections in fixed point.
//!
//! A section is stored as a biquad and played as a normalised lattice of two stages with taps (Gray and Markel, *A
//! normalized digital filter structure*, IEEE Trans. ASSP 23(3), 1975). [`crate::lattice`] has the all-pole part.
//!
//! ```text
//! k2 = a2    k1 = a1 / (1 + a2)    y = v0 g0 + v1 g1 + v2 g2,  g the backward signals
//! v2 = b2    v1 = (b1 - b2 a1) / cos θ2    v0 = (b0 - b2 a2 - v1 cos θ2 k1) / (cos θ1 cos θ2)
//! ```
//! The biquad itself is not played, because a direct recursion, truncated or rounded, may ring forever without an
//! input. Error feedback moves that noise elsewhere but does not end it. Here no rotation lengthens its vector (cos² +
//! sin² ≤ 2⁶² in the integers) and products are truncated toward zero, so that the state decays to exact zero, whatever
//! the poles and however they change; `tests/kernel/lattice.rs` has the proof. The taps are not recursive.
//!
//! Internal signals have steps of 2⁻¹⁵ m/s² and 32 times the output's full scale. A section at the limit of the poles'
//! radius raises a full-scale tone to this level within its lattice.

use heapless::Vec;
use model_format::OutputSample;
use model_format::scene::Biquad;
use model_format::scene::limits::{MAX_RESPONSE_SECTIONS, MAX_SECTIONS};

use crate::fixed::{high_word_toward_zero, is_full_scale, saturate, shift_toward_zero};

/// Binary digits after the point that internal signals have fewer than the output.
const HEADROOM_BITS: u32 = 5;

/// Binary digits after the point of a tap, which lies between -32 and 32. A section's taps are an orthonormal expansion
/// of its impulse response: the sums of squares are equal, so that no tap is above the largest gain, 16.
const TAP_FRACTION_BITS: u32 = 26;

/// Largest number of sections of a cascade: those of a scene, and those of the device's response.
const ROOM: usize = MAX_SECTIONS + MAX_RESPONSE_SECTIONS;

/// A section as it is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Section {
    /// (cos θ, sin θ) of stage 1 and of stage 2, in steps of 2⁻³¹.
    rotations: [(i32, i32); 2],
    /// v0, v1, v2.
    taps: [i32; 3],
}

/// A cascade of sections.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Equaliser {
    sections: Vec<Section, ROOM>,
}

/// State of an equaliser: the backward signals of all sections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EqualiserState {
    /// g0 and g1 of each section.
    backward: [[i32; 2]; ROOM],
}

impl Section {
    fn new(biquad: &Biquad) -> Self {
        const ONE: i64 = 1 << Biquad::FRACTION_BITS;
        let [a1, a2] = biquad.denominator.map(i64::from);
        // Within Jury's triangle 1 + a2 is positive, and |a1| is below it.
        let one = rotation((a1 << 31) / (ONE + a2));
        let two = rotation(a2 << (31 - Biquad::FRACTION_BITS));
        let [a1, a2] = biquad.denominator();
        let [b0, b1, b2] = biquad.numerator();
        // The taps are differences of near numbers, divided by small cosines, so that they need the digits of `f64`.
        let number = |q31: i32| f64::from(q31) / (1u64 << 31) as f64;
        let (cos1, cos2) = (number(one.0), number(two.0));
        let cos2_v1 = b1 - b2 * a1;
        let v0 = (b0 - b2 * a2 - cos2_v1 * number(one.1)) / (cos1 * cos2);
        let tap = |value: f64| (value * (1u64 << TAP_FRACTION_BITS) as f64) as i32;
        Self {
            rotations: [one, two],
            taps: [tap(v0), tap(cos2_v1 / cos2), tap(b2)],
        }
    }

    /// Passes one sample through the section. The flag is true if its state or its output is at full scale, and not
    /// for f1 or g2 alone, whose check would take time in each tick.
    #[inline(always)]
    fn process(&self, backward: &mut [i32; 2], input: i32) -> (i32, bool) {
        let [one, two] = self.rotations;
        let (f1, g2) = rotate(two, input, backward[1]);
        let (f0, g1) = rotate(one, f1, backward[0]);
        *backward = [f0, g1];
        let [v0, v1, v2] = self.taps.map(i64::from);
        let sum = v0 * i64::from(f0) + v1 * i64::from(g1) + v2 * i64::from(g2);
        let (output, saturated) = saturate(shift_toward_zero(sum, TAP_FRACTION_BITS));
        let full = saturated | is_full_scale(f0) | is_full_scale(g1);
        (output, full)
    }
}

/// The rotation whose sine is `sin`, in steps of 2⁻³¹ and below 2³¹: cos² + sin² ≤ 2⁶² in the integers.
fn rotation(sin: i64) -> (i32, i32) {
    let cos = ((1u64 << 62) - sin.unsigned_abs().pow(2)).isqrt();
    (cos.min(i32::MAX as u64) as i32, sin as i32)
}

/// One stage. Returns forward and backward signal, in that order.
#[inline(always)]
fn rotate((cos, sin): (i32, i32), forward: i32, backward: i32) -> (i32, i32) {
    let (cos, sin) = (i64::from(cos), i64::from(sin));
    let (f, g) = (i64::from(forward), i64::from(backward));
    let down = high_word_toward_zero(cos * f - sin * g);
    let up = high_word_toward_zero(sin * f + cos * g);
    (down.saturating_add(down), up.saturating_add(up))
}

impl Equaliser {
    /// The equaliser that leaves the output as it is.
    pub const NONE: Self = Self { sections: Vec::new() };

    /// The cascade of `biquads`, as many as fit. Their poles must be within the limit.
    pub fn new(biquads: &[Biquad]) -> Self {
        Self {
            sections: biquads.iter().take(ROOM).map(Section::new).collect(),
        }
    }

    /// Appends the sections of `biquads`, as many as fit.
    pub(super) fn append(&mut self, biquads: &[Biquad]) {
        for biquad in biquads {
            let _ = self.sections.push(Section::new(biquad));
        }
    }

    /// Number of sections.
    pub fn len(&self) -> usize {
        self.sections.len()
    }

    /// Returns whether there is no section.
    pub fn is_empty(&self) -> bool {
        self.sections.is_empty()
    }
}

impl EqualiserState {
    /// The state at rest.
    pub const fn new() -> Self {
        Self {
            backward: [[0; 2]; ROOM],
        }
    }

    /// Passes one sample through the cascade. The flag is true if the state or the output of a section, or the
    /// cascade's output, is at full scale.
    #[inline]
    pub fn process(&mut self, equaliser: &Equaliser, input: OutputSample) -> (OutputSample, bool) {
        let mut signal = shift_toward_zero(i64::from(input.0), HEADROOM_BITS) as i32;
        let mut saturated = false;
        for (section, backward) in equaliser.sections.iter().zip(&mut self.backward) {
            let (output, full) = section.process(backward, signal);
            signal = output;
            saturated |= full;
        }
        let (output, full) = saturate(i64::from(signal) << HEADROOM_BITS);
        (OutputSample(output), saturated | full)
    }

    /// Returns whether the state is zero, so that the output is zero until the next input.
    pub fn is_silent(&self) -> bool {
        let all = self.backward.as_flattened().iter();
        // All signals are looked at, because the tick asks, and its instructions must not depend on the data.
        all.fold(0, |any, &signal| any | signal) == 0
    }

    /// The square of the state's norm, in steps of 2⁻¹⁵ m/s².
    pub fn square_norm(&self) -> u128 {
        let signals = self.backward.as_flattened().iter();
        signals.map(|&signal| u128::from(signal.unsigned_abs()).pow(2)).sum()
    }
}
