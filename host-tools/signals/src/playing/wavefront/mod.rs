//! The kernel's arithmetic on a host: several samples of a lattice in one pass over its stages, in the processor's
//! vectors, with the bits of the kernel's own [`Portable`].
//!
//! A stage of a lattice needs the stage before of the same sample, and the stage below of the sample before. So the
//! stages of one sample cannot go side by side, but samples can: each is two stages behind the one before, and finds
//! the backward signal that it needs in its neighbour's lane of the step before. This order of work is known as a
//! wavefront. No sum changes, so that no bit does.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(test)]
mod tests;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// The arithmetic of the fastest instructions that this processor has; [`Portable`]'s if it has none of those known
/// here.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wavefront;

/// Sets of instructions that have their own arithmetic.
#[derive(Clone, Copy, Debug)]
enum Level {
    /// None: the kernel's portable arithmetic.
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

    /// All levels of this processor, the slowest first.
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
