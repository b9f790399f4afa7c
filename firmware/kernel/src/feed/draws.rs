//! The random choices of a feed.

use rand_core::Rng;
use rand_pcg::Pcg32;

use crate::excitation::hashed;

/// The random choices of a feed.
#[derive(Clone, Debug)]
pub(super) struct Draws(Pcg32);

impl Draws {
    /// Choices that are the same for the same seed.
    pub fn new(seed: u64) -> Self {
        /// Any odd increment gives the full period; this one differs from the Gaussian noise's.
        const STREAM: u64 = 0x5851_f42d_4c95_7f2d;
        /// Digits of √2, so that the state also differs from the Gaussian noise's, for this or a related seed.
        const OTHER: u64 = 0x6a09_e667_f3bc_c908;
        Self(Pcg32::new(hashed(seed ^ OTHER), STREAM))
    }

    /// Returns a random number below `count`, uniform within a relative 2⁻³² · `count`; 0 if `count` is 0.
    pub fn below(&mut self, count: u32) -> u32 {
        ((u64::from(self.0.next_u32()) * u64::from(count)) >> 32) as u32
    }
}
