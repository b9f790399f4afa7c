//! The two-multiplier all-pole lattice in 32 bits.
//!
//! ```text
//! F[m-1] = F[m] - k[m] · G[m-1]      for m = M .. 1, with G the backward signals of the sample before,
//! G[m]   = G[m-1] + k[m] · F[m-1]    F[M] the excitation times √Π(1 - k²), F[0] = G[0] the output
//! ```
//! It has half the multiplications of the normalised lattice. Its signals are those of the normalised one, each times
//! a factor that depends on the coefficients of the stages below. The state's norm is therefore no measure of energy,
//! and while coefficients change it can grow without any input. Products are rounded to nearest, which is one
//! instruction on a Cortex-M4, so that silence need not be exact. Every signal is kept within full scale, eight
//! standard deviations of the output.
//!
//! Backward signals are kept doubled, because the upper word of a Q31 product is half of it: k · 2G has F's scale.

use core::cell::Cell;

use model_format::limits::MAX_ORDER;
use model_format::{OutputSample, Texture};

use super::theta;
use crate::excitation;
use crate::grid::GridPoint;
use crate::level::{Levels, Ramp};

/// Full scale of the forward signals is 2²⁹: four times one must still be a word.
pub const FULL_SCALE_BITS: u32 = 29;

const FULL_SCALE: i32 = 1 << FULL_SCALE_BITS;

/// The frame of a motion: reflection coefficients of all stages, the excitation's deviation, and the level.
#[derive(Clone, Debug)]
pub struct TwoMultiplierFrame {
    /// k in steps of 2⁻³¹.
    reflection: [i32; MAX_ORDER],
    stages: usize,
    /// √Π(1 - k²), the excitation's deviation over the output's, in steps of 2⁻³¹.
    deviation: i32,
    gain: Ramp,
}

/// The state of a lattice: the backward signals, doubled.
#[derive(Clone, Debug)]
pub struct TwoMultiplierState {
    /// 2·G[0] to 2·G[M]; the last is written and never read.
    doubled: [i32; MAX_ORDER + 1],
}

impl TwoMultiplierFrame {
    /// A silent frame of `stages` stages, at most [`MAX_ORDER`].
    pub const fn silent(stages: usize) -> Self {
        assert!(stages <= MAX_ORDER);
        Self {
            reflection: [0; MAX_ORDER],
            stages,
            deviation: i32::MAX,
            gain: Ramp::new(),
        }
    }

    /// Makes this the frame of `point` on the grid of `texture`, a lattice of at most as many stages. The level goes
    /// from `from`, that of the frame before, to its new value in `samples` samples.
    pub fn update(&mut self, texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) {
        let mut deviation = 1.0;
        let reflection = &mut self.reflection[..self.stages];
        theta::interpolate(texture, point, reflection, |rotation| {
            deviation *= rotation.cos as f32 / (1u32 << 31) as f32;
            rotation.sin
        });
        // The cast to an integer saturates, here at one.
        self.deviation = (deviation * (1u32 << 31) as f32) as i32;
        self.gain = theta::gain(texture, point, from, samples);
    }

    /// The level with `left` samples of the ramp to come, the fade included.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.gain.value(left),
            fade: 0,
        }
    }

    /// The reflection coefficients in steps of 2⁻³¹, the first stage's first.
    pub fn reflection(&self) -> &[i32] {
        &self.reflection[..self.stages]
    }

    /// Factor of the excitation, in steps of 2⁻³¹.
    pub fn deviation(&self) -> i32 {
        self.deviation
    }
}

impl TwoMultiplierState {
    /// A lattice at rest.
    pub const fn new() -> Self {
        Self {
            doubled: [0; MAX_ORDER + 1],
        }
    }

    /// A lattice whose backward signals are `backward`, `G[0]` first, kept within full scale.
    pub fn from_backward(backward: [i32; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        for (doubled, g) in state.doubled.iter_mut().zip(backward) {
            *doubled = 2 * within_full_scale(g);
        }
        state
    }

    /// The backward signals that `stages` stages remember, doubled, `G[0]` first. Their full scale is 2³⁰.
    pub fn doubled(&self, stages: usize) -> &[i32] {
        &self.doubled[..stages]
    }

    /// Passes one sample of excitation, `F[M]` at its own scale, through the lattice.
    #[inline]
    pub fn filter(&mut self, reflection: &[i32], excitation: i32) -> i32 {
        let reflection = &reflection[..reflection.len().min(MAX_ORDER)];
        let doubled = Cell::from_mut(&mut self.doubled[..=reflection.len()]).as_slice_of_cells();
        let mut forward = within_full_scale(excitation);
        for (&k, pair) in reflection.iter().zip(doubled.windows(2)).rev() {
            let backward = pair[0].get();
            forward = within_full_scale(forward - high_word(k, backward));
            let next = backward + high_word(k, forward << 2);
            pair[1].set(next.clamp(-2 * FULL_SCALE, 2 * FULL_SCALE - 1));
        }
        self.doubled[0] = 2 * forward;
        forward
    }

    /// The next sample of a texture: `excitation`, in steps of 2⁻²⁸ of a standard deviation, through the lattice of
    /// `frame`, at its level with `left` samples of its ramp to come. The flag is true if the output is at full scale.
    #[inline]
    pub fn next_sample(
        &mut self,
        frame: &TwoMultiplierFrame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        /// Shift from the excitation's scale, times a Q31 factor, to that of the forward signals.
        const SHIFT: u32 = 31 + excitation::FRACTION_BITS + 3 - FULL_SCALE_BITS;
        let product = i64::from(excitation) * i64::from(frame.deviation);
        let driven = ((product + (1 << (SHIFT - 1))) >> SHIFT) as i32;
        let filtered = self.filter(frame.reflection(), driven);
        let output = theta::output(filtered, frame.gain.value(left), FULL_SCALE_BITS);
        #[expect(
            clippy::needless_bitwise_bool,
            reason = "a lazy operator may become a branch, whose path would depend on the data"
        )]
        let at_full_scale = (filtered == FULL_SCALE - 1) | (filtered == -FULL_SCALE);
        (output, at_full_scale)
    }
}

impl Default for TwoMultiplierState {
    fn default() -> Self {
        Self::new()
    }
}

/// The upper word of a product, rounded to nearest: one SMMULR.
#[inline(always)]
fn high_word(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b) + (1 << 31)) >> 32) as i32
}

/// `signal` saturated to full scale: one SSAT.
#[inline(always)]
fn within_full_scale(signal: i32) -> i32 {
    signal.clamp(-FULL_SCALE, FULL_SCALE - 1)
}
