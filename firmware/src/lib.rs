//! Instructions of the stylus's processor that no compiler generates by itself, for the kernel's inner loops.
//!
//! They are those of ARMv7E-M (ARM DDI 0403E, chapter A7), so that a Cortex-M4 and a Cortex-M7 run them to the same
//! bits. Their order is for a Cortex-M7, which issues up to two instructions per cycle, in order, and waits for results.
//!
//! All unsafe code of the product is in this package. On a host this library is empty.
#![no_std]
#![cfg(target_arch = "arm")]

mod interpolate;
mod products;
mod rotate;

use stylus_kernel::arithmetic::{Arithmetic, SUMS, Turn};
use stylus_kernel::rotation::Rotation;
use stylus_kernel::taps;
use stylus_kernel::theta::Run;

/// The kernel's arithmetic in the processor's own instructions.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

impl Arithmetic for CortexM {
    #[inline(always)]
    fn sums_of_products(coefficients: &[Turn], samples: &[i32]) -> [i64; SUMS] {
        products::sums_of_products(coefficients, samples)
    }

    #[inline(always)]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        rotate::rotate(rotations, backward, forward)
    }

    #[inline]
    fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
        interpolate::mean_rotations(run, rotations);
    }

    #[inline]
    fn mean_coefficients(run: &taps::Run<'_>, coefficients: &mut [i32]) {
        interpolate::mean_coefficients(run, coefficients);
    }
}
