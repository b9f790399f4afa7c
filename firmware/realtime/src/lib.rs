//! The time-critical part of the stylus's image: from the reset to the tick and the update.
//!
//! This part is a package of its own because it is compiled for speed, and the rest of the image for size.
//!
//! `tick` imports `boot` and `play`, and `boot` imports no module. Without the feature `image` the crate has only
//! `CortexM`, which gives the kernel `rotate` and `interpolate`; the emulated kernel uses this form. On a host this
//! library is empty. The instructions are those of ARMv7E-M (ARM DDI 0403E, chapter A7), so a Cortex-M4 and a Cortex-M7
//! compute the same bits. The instructions are ordered for a Cortex-M7, which issues up to two instructions per cycle,
//! in order, and waits for results.
#![no_std]
#![cfg(target_arch = "arm")]

/// From reset to running: watchdog, memory layout, clocks, silicon, supply, interrupt priorities, and the cause of the
/// reset.
///
/// Invariant: no file here imports another module of the crate. The watchdog counts and the output is at mid-scale
/// before any Rust code runs.
#[cfg(feature = "image")]
pub mod boot {
    pub mod clock;
    pub mod critical;
    pub mod priority;
    pub mod protection;
    pub mod silicon;
    pub mod startup;
}

#[cfg(feature = "fault-injection")]
pub mod injection;
mod interpolate;

/// Decides what is played, at a lower priority than the tick: one block every 2 ms, from the library in RAM, handed to
/// the tick.
///
/// Invariant: everything shared with the tick has one owner at any time, by the protocol at the beginning of its
/// module. No lock is taken.
#[cfg(feature = "image")]
pub mod play {
    pub mod direction;
    pub mod library_ram;
    pub mod shared;
    pub mod update;
    pub mod voice;
}

mod rotate;

/// The tick: one sample, 5000 times per second. It reads the inputs, computes the sample of the block that is played,
/// applies the safety stages, and writes the output.
///
/// Invariant: no lock, log, flash access, allocation, wait, or path that depends on the data; code in ITCM, data in
/// DTCM.
#[cfg(feature = "image")]
pub mod tick {
    pub mod alive;
    mod handler;
    pub mod inputs;
    pub mod output;
    pub mod raising;
    pub mod supply;

    #[cfg(feature = "fault-injection")]
    pub use handler::age;
    pub use handler::{configure, heat, is_at_rest, now, play, set_heat, set_muted, snapshot, start, stop, take_range};
}

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
