//! The normalised lattice in 16 bits: states, sines and cosines; see [`crate::lattice`] for the structure.
//!
//! One standard deviation is 2¹² steps, full scale eight of them. cos² + sin² ≤ 2³⁰ holds in the integers, and
//! results are rounded to nearest, because truncation toward zero, as in the 32-bit lattice, would leave 15 dB of
//! signal to noise at order 400. Each stage can therefore lengthen its vector by up to √½ of a step: the state's norm
//! is bounded, and after the excitation stops a few steps may remain for ever. Against float64 with the stored θ it
//! has 47 to 56 dB at order 400.

use core::cell::Cell;

use model_format::limits::MAX_ORDER;
use model_format::{OutputSample, Texture};

use super::theta;
use crate::excitation;
use crate::grid::GridPoint;
use crate::level::{Levels, Ramp};
use crate::rotation::Rotation;

/// Full scale of all signals is 2¹⁵.
pub const FULL_SCALE_BITS: u32 = 15;

/// A rotation in steps of 2⁻¹⁵ that lengthens no vector by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Rotation16 {
    /// cos θ, not negative.
    pub cos: i16,
    /// sin θ.
    pub sin: i16,
}

/// The frame of a motion: rotations of all stages, and the level.
#[derive(Clone, Debug)]
pub struct Lattice16Frame {
    rotations: [Rotation16; MAX_ORDER],
    stages: usize,
    gain: Ramp,
}

/// The state of a lattice: the backward signals.
#[derive(Clone, Debug)]
pub struct Lattice16State {
    /// g[0] to g[M]. The last is written and never read.
    backward: [i16; MAX_ORDER + 1],
}

impl Rotation16 {
    /// No rotation.
    pub const NONE: Self = Self {
        cos: i16::MAX,
        sin: 0,
    };
}

impl From<Rotation> for Rotation16 {
    /// Both to the nearest step. Where that is too long, the larger one loses a step, which moves the angle least.
    fn from(rotation: Rotation) -> Self {
        const ONE: u32 = 1 << FULL_SCALE_BITS;
        let nearest = |value: i32| ((value.unsigned_abs() + (1 << 15)) >> 16).min(ONE - 1);
        let (mut cos, mut sin) = (nearest(rotation.cos), nearest(rotation.sin));
        let excess = u32::from(cos * cos + sin * sin > ONE * ONE);
        if cos > sin {
            cos -= excess;
        } else {
            sin -= excess;
        }
        let sin = sin as i16;
        Self {
            cos: cos as i16,
            sin: if rotation.sin < 0 { -sin } else { sin },
        }
    }
}

impl Lattice16Frame {
    /// A silent frame of `stages` stages, at most [`MAX_ORDER`].
    pub const fn silent(stages: usize) -> Self {
        assert!(stages <= MAX_ORDER);
        Self {
            rotations: [Rotation16::NONE; MAX_ORDER],
            stages,
            gain: Ramp::new(),
        }
    }

    /// Makes this the frame of `point` on the grid of `texture`, a lattice of at most as many stages. The level goes
    /// from `from`, that of the frame before, to its new value in `samples` samples.
    pub fn update(&mut self, texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) {
        let rotations = &mut self.rotations[..self.stages];
        theta::interpolate(texture, point, rotations, Rotation16::from);
        self.gain = theta::gain(texture, point, from, samples);
    }

    /// The level with `left` samples of the ramp to come, the fade included.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.gain.value(left),
            fade: 0,
        }
    }

    /// The rotations of the stages, the first stage first.
    pub fn rotations(&self) -> &[Rotation16] {
        &self.rotations[..self.stages]
    }
}

impl Lattice16State {
    /// A lattice at rest.
    pub const fn new() -> Self {
        Self {
            backward: [0; MAX_ORDER + 1],
        }
    }

    /// A lattice whose backward signals are `backward`, `g[0]` first.
    pub fn from_backward(backward: [i16; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        state.backward[..MAX_ORDER].copy_from_slice(&backward);
        state
    }

    /// The backward signals that `stages` stages remember, `g[0]` first.
    pub fn backward(&self, stages: usize) -> &[i16] {
        &self.backward[..stages]
    }

    /// Passes one sample of excitation through the lattice, both in steps of 2⁻¹² of a standard deviation.
    #[inline]
    pub fn filter(&mut self, rotations: &[Rotation16], excitation: i16) -> i16 {
        let rotations = &rotations[..rotations.len().min(MAX_ORDER)];
        let backward = Cell::from_mut(&mut self.backward[..=rotations.len()]).as_slice_of_cells();
        let mut forward = i32::from(excitation);
        for (rotation, pair) in rotations.iter().zip(backward.windows(2)).rev() {
            let (cos, sin) = (i32::from(rotation.cos), i32::from(rotation.sin));
            let g = i32::from(pair[0].get());
            let down = cos * forward - sin * g;
            let up = sin * forward + cos * g;
            pair[1].set(rounded(up, FULL_SCALE_BITS));
            forward = i32::from(rounded(down, FULL_SCALE_BITS));
        }
        let output = forward as i16;
        self.backward[0] = output;
        output
    }

    /// The next sample of a texture: `excitation`, in steps of 2⁻²⁸ of a standard deviation, through the lattice of
    /// `frame`, at its level with `left` samples of its ramp to come. The flag is true if the lattice is at full scale.
    #[inline]
    pub fn next_sample(
        &mut self,
        frame: &Lattice16Frame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let driven = rounded(excitation, excitation::FRACTION_BITS + 3 - FULL_SCALE_BITS);
        let filtered = self.filter(frame.rotations(), driven);
        let output = theta::output(i32::from(filtered), frame.gain.value(left), FULL_SCALE_BITS);
        #[expect(
            clippy::needless_bitwise_bool,
            reason = "a lazy operator may become a branch, whose path would depend on the data"
        )]
        let at_full_scale = (filtered == i16::MAX) | (filtered == i16::MIN);
        (output, at_full_scale)
    }
}

impl Default for Lattice16State {
    fn default() -> Self {
        Self::new()
    }
}

/// `value` / 2^`bits`, to nearest, saturated: an addition and an SSAT with a shift. The magnitude of `value` is at most
/// 2³¹ - 2^`bits`; an excitation beyond any that the generator gives saturates too.
#[inline(always)]
fn rounded(value: i32, bits: u32) -> i16 {
    let nearest = value.saturating_add(1 << (bits - 1)) >> bits;
    nearest.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16
}
