//! The kernel's arithmetic on a host. It passes several samples through the stages of a lattice at once, in the
//! processor's vectors, and gives the same bits as the kernel's own [`Portable`].
//!
//! A stage of a lattice needs the result of the previous stage for the same sample, and the result of the stage below
//! for the previous sample. So the stages of one sample cannot be computed in parallel, but several samples can: each
//! sample is two stages behind the previous one, and finds the backward signal that it needs in its neighbour's lane,
//! from the step before. This order of computation is known as a wavefront. No sum changes, so no bit changes.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(test)]
mod tests;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// The arithmetic with the fastest instructions that this processor has and that are supported here; otherwise that of
/// [`Portable`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Wavefront;

/// Instruction sets that have their own arithmetic.
#[derive(Clone, Copy, Debug)]
enum Level {
    /// No special instructions: the kernel's portable arithmetic.
    Scalar,
    /// AVX2 on x86-64.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
}

impl Level {
    /// The fastest level of this processor.
    fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(instructions) = pulp::x86::V3::try_new() {
            return Self::Avx2(instructions);
        }
        Self::Scalar
    }

    /// All levels of this processor, from the slowest to the fastest.
    #[cfg(test)]
    fn all() -> Vec<Self> {
        match Self::best() {
            Self::Scalar => vec![Self::Scalar],
            #[cfg(target_arch = "x86_64")]
            best @ Self::Avx2(_) => vec![Self::Scalar, best],
        }
    }

    /// See [`Arithmetic::rotate_block`].
    fn rotate_block(self, rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
        match self {
            Self::Scalar => Portable::rotate_block(rotations, backward, samples),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(instructions) => {
                avx2::rotate_block(instructions, rotations, backward, samples);
            }
        }
    }
}

impl Arithmetic for Wavefront {
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        Portable::rotate(rotations, backward, forward)
    }

    fn rotate_block(rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
        Level::best().rotate_block(rotations, backward, samples);
    }
}
