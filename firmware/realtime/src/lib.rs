//! The time-critical part of the stylus's image: from the reset to the tick and the update.
//!
//! This part is a package of its own because it is compiled for speed, and the rest of the image for size.
//!
//! | module | content |
//! |---|---|
//! | `boot` | from reset to running: memory, clocks, interrupt priorities, cause of the reset; imports no module |
//! | `play` | one block every 2 ms, handed to the tick |
//! | `tick` | one sample, 5000 times per second |
//! | `rotate` | stages of the lattice in the processor's own instructions |
//! | `interpolate` | means of rotations between nodes, in the processor's own instructions |
//! | `injection` | faults on request, only in the image for tests |
//!
//! `tick` imports `play`. Without the feature `image` the crate has only `CortexM`, which gives the kernel `rotate` and
//! `interpolate`; the emulated kernel uses this form. On a host this library is empty. The instructions are those of
//! ARMv7E-M (ARM DDI 0403E, chapter A7), so a Cortex-M4 and a Cortex-M7 compute the same bits. The instructions are
//! ordered for a Cortex-M7, which issues up to two instructions per cycle, in order, and waits for results.
#![no_std]
#![cfg(target_arch = "arm")]

#[cfg(feature = "image")]
pub mod boot;
#[cfg(feature = "fault-injection")]
pub mod injection;
mod interpolate;
#[cfg(feature = "image")]
pub mod play;
mod rotate;
#[cfg(feature = "image")]
pub mod tick;

use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::theta::Run;

/// The kernel's arithmetic in the processor's own instructions.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

impl Arithmetic for CortexM {
    #[inline(always)]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        rotate::rotate(rotations, backward, forward)
    }

    #[inline]
    fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
        interpolate::mean_rotations(run, rotations);
    }
}
