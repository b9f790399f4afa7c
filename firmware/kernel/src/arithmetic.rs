//! The arithmetic of the inner loops, as a trait: a processor whose instructions a compiler does not find brings its
//! own implementation. [`Portable`] is the reference, and every other gives the same bits.

use core::cell::Cell;
use core::sync::atomic::{Ordering, compiler_fence};

use crate::fixed::high_word_toward_zero;
use crate::rotation::Rotation;

/// Number of taps that are summed in one turn of the loop.
pub const TURN_TAPS: usize = 40;

/// Coefficients or samples of one turn.
pub type Turn = [i32; TURN_TAPS];

/// The operations of the inner loops.
pub trait Arithmetic: Copy {
    /// Σ a·b over as many turns as both have, in 64 bits.
    ///
    /// The sum is exact. It wraps only if it overflows, which no valid library's coefficients can cause.
    fn sum_of_products(coefficients: &[Turn], samples: &[Turn]) -> i64;

    /// Passes `forward` through the stages of a lattice, the last of `rotations` first, and returns the output; see
    /// [`crate::lattice`].
    ///
    /// `backward` holds one word more than there are stages. Word m - 1 is the backward signal that stage m reads and
    /// word m the one that it writes. The caller writes word 0.
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32;

    /// Passes two samples through at once: the bits of two calls of [`Arithmetic::rotate`] with word 0 written in
    /// between.
    ///
    /// The second sample follows the first one stage behind. It takes the first one's backward signal before that
    /// goes to memory, and one pass over the rotations serves both.
    fn rotate_two(rotations: &[Rotation], backward: &mut [i32], forward: [i32; 2]) -> [i32; 2];
}

/// The reference, in plain Rust.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable;

impl Arithmetic for Portable {
    #[inline]
    fn sum_of_products(coefficients: &[Turn], samples: &[Turn]) -> i64 {
        let (coefficients, samples) = (coefficients.as_flattened(), samples.as_flattened());
        coefficients.iter().zip(samples).fold(0, |sum, (&a, &b)| {
            sum.wrapping_add(i64::from(a) * i64::from(b))
        })
    }

    #[inline]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], mut forward: i32) -> i32 {
        let backward = Cell::from_mut(backward).as_slice_of_cells();
        for (&rotation, pair) in rotations.iter().zip(backward.windows(2)).rev() {
            let up;
            (forward, up) = rotated(rotation, forward, pair[0].get());
            pair[1].set(up);
            // This is no instruction. It keeps the compiler from running ahead along the forward path, because that
            // takes more registers than there are and doubles the time of a stage on a Cortex-M4.
            compiler_fence(Ordering::SeqCst);
        }
        forward
    }

    #[inline]
    fn rotate_two(
        rotations: &[Rotation],
        backward: &mut [i32],
        [mut first, mut second]: [i32; 2],
    ) -> [i32; 2] {
        let Some((&last, others)) = rotations.split_last() else {
            return [first, second];
        };
        let mut up;
        (first, up) = rotated(last, first, backward[others.len()]);
        backward[rotations.len()] = up;
        for (stage, pair) in rotations.windows(2).enumerate().rev() {
            (first, up) = rotated(pair[0], first, backward[stage]);
            (second, up) = rotated(pair[1], second, up);
            backward[stage + 2] = up;
        }
        (second, up) = rotated(rotations[0], second, first);
        backward[1] = up;
        [first, second]
    }
}

/// One stage of a lattice: the forward signal for the stage below, and the backward signal for the stage above.
#[inline(always)]
pub fn rotated(rotation: Rotation, forward: i32, backward: i32) -> (i32, i32) {
    let (cos, f, g) = (
        i64::from(rotation.cos),
        i64::from(forward),
        i64::from(backward),
    );
    // One 64-bit sum and one truncation each: two separate products would break the bound by a step.
    let down = high_word_toward_zero(cos * f + i64::from(rotation.neg_sin) * g);
    let up = high_word_toward_zero(i64::from(rotation.sin) * f + cos * g);
    (down.saturating_add(down), up.saturating_add(up))
}
