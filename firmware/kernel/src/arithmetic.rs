//! The arithmetic of the inner loops, as a trait: a processor with instructions that compilers do not use brings its
//! own implementation. [`Portable`] is the reference, and every other implementation gives the same bits.

use core::cell::Cell;
use core::sync::atomic::{Ordering, compiler_fence};

use crate::fixed::high_word_toward_zero;
use crate::rotation::Rotation;
use crate::theta::{self, Run};

/// The operations of the inner loops.
pub trait Arithmetic: Copy {
    /// Passes `forward` through the stages of a lattice, the last of `rotations` first, and returns the output; see
    /// [`crate::lattice`].
    ///
    /// `backward` holds one word more than there are stages. Stage m reads its backward signal from word m - 1 and
    /// writes word m. The caller writes word 0.
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32;

    /// Computes the rotation of each stage of `run` from the sum of its four nodes' θ, and writes it to `rotations`,
    /// which holds one rotation per stage.
    ///
    /// Each product with a factor is rounded down by itself, and their sum goes through [`Rotation::from_sum`].
    #[inline]
    fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
        theta::mean_rotations(run, rotations);
    }

    /// Passes a block of samples through, replacing each by its output: the same bits as a call of
    /// [`Arithmetic::rotate`] per sample. Unlike that call, it also writes word 0.
    ///
    /// No device knows so many samples ahead. This is for programs that know them, on processors that compute several
    /// samples at once.
    fn rotate_block(rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
        for sample in samples {
            *sample = Self::rotate(rotations, backward, *sample);
            backward[0] = *sample;
        }
    }
}

/// The reference, in plain Rust.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable;

impl Arithmetic for Portable {
    #[inline]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], mut forward: i32) -> i32 {
        // Each pair of words overlaps the next, and slices have no mutable windows that do.
        let backward = Cell::from_mut(backward).as_slice_of_cells();
        for (&rotation, pair) in rotations.iter().zip(backward.windows(2)).rev() {
            let up;
            (forward, up) = rotated(rotation, forward, pair[0].get());
            pair[1].set(up);
            // The fence is no instruction. It keeps the compiler from running ahead along the forward path, which needs
            // more registers than there are and doubles the time of a stage on a Cortex-M4.
            compiler_fence(Ordering::SeqCst);
        }
        forward
    }
}

/// One stage of a lattice: the forward signal for the stage below, and the backward signal for the stage above.
#[inline(always)]
pub fn rotated(rotation: Rotation, forward: i32, backward: i32) -> (i32, i32) {
    let (cos, f, g) = (i64::from(rotation.cos), i64::from(forward), i64::from(backward));
    // One 64-bit sum and one truncation each, because two separate products would break the bound by a step.
    let down = high_word_toward_zero(cos * f + i64::from(rotation.neg_sin) * g);
    let up = high_word_toward_zero(i64::from(rotation.sin) * f + cos * g);
    // With rotations in steps of 2⁻³¹ the upper word is half the result. Two signals at full scale turn into one of √2
    // times full scale, so that doubling must saturate.
    (down.saturating_add(down), up.saturating_add(up))
}
