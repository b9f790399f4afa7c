//! The kernel's inner loops, in instructions of ARMv7E-M that no compiler generates for them.
//!
//! A Cortex-M4 and a Cortex-M7 have the same instructions, and each runs either order of them to the same bits. They
//! differ in what an order costs. The instructions and their operands are those of ARM DDI 0403E, chapter A7.

mod cortex_m4;
mod cortex_m7;
mod two_samples;

use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::theta::Run;

use crate::interpolate;

/// The arithmetic in the order for a Cortex-M4.
///
/// It issues one instruction per cycle, and every instruction that loads takes a cycle more than its words. So the
/// order loads many words at once.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM4;

/// The arithmetic in the order for a Cortex-M7.
///
/// It issues up to two instructions per cycle, in order, and waits for results. So the order begins the next stage
/// while the signals of the present one are on their way.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM7;

/// The operations that both orders share, and the stages of one.
macro_rules! arithmetic {
    ($name:ident, $rotate:path) => {
        impl Arithmetic for $name {
            #[inline(always)]
            fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
                $rotate(rotations, backward, forward)
            }

            #[inline(always)]
            fn rotate_two(
                rotations: &[Rotation],
                backward: &mut [i32],
                forward: [i32; 2],
            ) -> [i32; 2] {
                two_samples::rotate_two(rotations, backward, forward)
            }

            #[inline]
            fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
                interpolate::mean_rotations(run, rotations);
            }
        }
    };
}

arithmetic!(CortexM4, cortex_m4::rotate);
arithmetic!(CortexM7, cortex_m7::rotate);
