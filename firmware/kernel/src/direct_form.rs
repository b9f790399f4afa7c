//! The direct form, the paper's own structure: `a[n] = σ e[n] + Σ h[i] a[n-i]`.
//!
//! `stylus frontier` compares it with the lattice. It needs the feature `direct-form`, which no image has.
//!
//! The predictors h of the four nodes around the motion are averaged, as in the paper, and so is the power σ² of the
//! prediction error. The direct form is cheaper than a lattice, but its stability depends on its coefficients: between
//! two stable nodes it may be unstable, and then it saturates.
//!
//! The predictors are not part of a library. A host computes them from the nodes of a lattice, and passes those around
//! the motion. The history is kept in fixed point at the texture's own scale: its loudest node's RMS lies between a
//! sixteenth and an eighth of full scale, or below if it is under 2⁻¹³ m/s². Sums of products are exact in 64 bits.
//! They are rounded down to 2⁻²⁰ of a step, and with the excitation truncated toward zero to a step.

use model_format::limits::{MAX_ORDER, MAX_OUTPUT_POWER};
use model_format::{OutputSample, Texture};

use crate::excitation;
use crate::fixed::{saturate, shift_toward_zero};
use crate::grid::{GridPoint, ONE};
use crate::level::{Levels, Ramp, rms_at};

/// Binary digits after the point of a sample's sum, relative to a step of the history.
pub const SUM_FRACTION_BITS: u32 = 20;

/// Binary digits after the point of a coefficient at exponent 0.
pub const COEFFICIENT_FRACTION_BITS: u32 = 31;

/// Largest exponent: coefficients of up to 2¹⁰ in magnitude.
pub const MAX_EXPONENT: u32 = 10;

/// Upper bound of Σ|code| of a node, not reached, so that no sum of products overflows, whatever the history.
pub const CODE_SUM_LIMIT: u64 = (1 << 32) - MAX_ORDER as u64;

/// The frame of a motion: coefficients and the level.
#[derive(Clone, Debug)]
pub struct DirectFrame {
    /// h₁ first; h = code · 2^(exponent - 31).
    coefficients: [i32; MAX_ORDER],
    taps: usize,
    exponent: u32,
    /// Binary logarithm of the number of steps of the history per step of the output.
    scale_bits: u32,
    deviation: Ramp,
    fade: Ramp,
}

/// The state of a direct form: the last outputs.
#[derive(Clone, Debug)]
pub struct DirectState {
    /// The newest [`MAX_ORDER`] samples from `newest` on, written twice so that they never wrap.
    history: [i32; 2 * MAX_ORDER],
    newest: usize,
}

impl DirectFrame {
    /// A silent frame for `texture`, whose predictors have this exponent, at most [`MAX_EXPONENT`].
    pub fn silent(texture: &Texture<'_>, exponent: u32) -> Self {
        Self {
            coefficients: [0; MAX_ORDER],
            taps: texture.max_order(),
            exponent: exponent.min(MAX_EXPONENT),
            scale_bits: scale_bits(texture.max_output_power()),
            deviation: Ramp::new(),
            fade: Ramp::new(),
        }
    }

    /// Makes this the frame of `point` on the grid of `texture`, for which it was created. `predictors` are those of
    /// the point's nodes, each with as many codes as the texture's highest order and a Σ|code| below
    /// [`CODE_SUM_LIMIT`]. Levels go from `from`, the previous frame's, to new values in `samples` samples.
    pub fn update(
        &mut self,
        texture: &Texture<'_>,
        point: &GridPoint,
        predictors: [&[i32]; 4],
        from: Levels,
        samples: u32,
    ) {
        let weights = point.weights.map(i64::from);
        let [a, b, c, d] = predictors;
        let codes = a.iter().zip(b).zip(c).zip(d);
        for (mean, (((a, b), c), d)) in self.coefficients[..self.taps].iter_mut().zip(codes) {
            let products = [a, b, c, d].map(|&code| i64::from(code));
            let sum = products.iter().zip(weights).map(|(code, weight)| code * weight);
            *mean = ((sum.sum::<i64>() + i64::from(ONE / 2)) >> ONE.ilog2()) as i32;
        }
        let bits = OutputSample::FRACTION_BITS + self.scale_bits;
        let power = |speed, force| texture.node(speed, force).prediction_error_power;
        let deviation = rms_at(point, texture.level_law(), bits, power);
        self.deviation = Ramp::between(from.amplitude, deviation, samples);
        self.fade = Ramp::between(from.fade, point.fade, samples);
    }

    /// The levels when `left` samples of their ramps remain.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.deviation.value(left),
            fade: self.fade.value(left),
        }
    }

    /// The coefficients, h₁ first.
    pub fn coefficients(&self) -> &[i32] {
        &self.coefficients[..self.taps]
    }
}

/// Binary digits by which the history's steps are finer than the output's, for a texture of this highest power.
fn scale_bits(max_output_power: f32) -> u32 {
    const FINEST: u32 = OutputSample::FRACTION_BITS;
    let mut bits = 0;
    let mut room = MAX_OUTPUT_POWER;
    while bits < FINEST && max_output_power <= room / 4.0 {
        room /= 4.0;
        bits += 1;
    }
    bits
}

impl DirectState {
    /// A filter at rest.
    pub const fn new() -> Self {
        Self {
            history: [0; 2 * MAX_ORDER],
            newest: 0,
        }
    }

    /// A filter whose last outputs are `history`, newest first.
    pub fn from_history(history: &[i32; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        let (first, second) = state.history.split_at_mut(MAX_ORDER);
        first.copy_from_slice(history);
        second.copy_from_slice(history);
        state
    }

    /// The last outputs, newest first, in steps of the history.
    pub fn history(&self) -> &[i32] {
        &self.history[self.newest..][..MAX_ORDER]
    }

    /// Passes one sample of excitation through the filter of `frame`. The excitation has steps of the history with
    /// [`SUM_FRACTION_BITS`] digits after the point; the output has steps of the history. The flag is true if the
    /// output was saturated.
    #[inline(always)]
    pub fn filter(&mut self, frame: &DirectFrame, excitation: i64) -> (i32, bool) {
        let products = frame.coefficients().iter().zip(self.history());
        let sum = products.fold(0, |sum: i64, (&h, &y)| {
            // [`CODE_SUM_LIMIT`] keeps the sum within 64 bits, so that no check of overflow is needed.
            sum.wrapping_add(i64::from(h) * i64::from(y))
        });
        let shift = COEFFICIENT_FRACTION_BITS - SUM_FRACTION_BITS - frame.exponent;
        let sum = excitation + (sum >> (shift & 31));
        let (output, saturated) = saturate(shift_toward_zero(sum, SUM_FRACTION_BITS));
        let newest = self.newest.checked_sub(1).unwrap_or(MAX_ORDER - 1);
        self.newest = newest;
        self.history[newest] = output;
        self.history[newest + MAX_ORDER] = output;
        (output, saturated)
    }

    /// Returns the next sample of a texture: `excitation`, in steps of 2⁻²⁸ of a standard deviation, through the filter
    /// of `frame`, when `left` samples of its ramps remain. The flag is true if the filter was saturated.
    #[inline]
    pub fn next_sample(&mut self, frame: &DirectFrame, excitation: i32, left: u32) -> (OutputSample, bool) {
        let driven = i64::from(excitation) * i64::from(frame.deviation.value(left));
        let driven = driven >> (excitation::FRACTION_BITS - SUM_FRACTION_BITS);
        let (filtered, saturated) = self.filter(frame, driven);
        let faded = i64::from(filtered) * i64::from(frame.fade.value(left));
        let output = shift_toward_zero(faded, ONE.ilog2() + frame.scale_bits);
        (OutputSample(output as i32), saturated)
    }
}

impl Default for DirectState {
    fn default() -> Self {
        Self::new()
    }
}
