//! The scale of a fed excitation.

use crate::excitation::{self, Excitation};

/// Binary digits after the point of a fed excitation: one standard deviation is 2²⁵, a 64th of full scale.
pub const FED_FRACTION_BITS: u32 = 25;

/// Number of binary digits after the point that a fed excitation has fewer than a Gaussian one.
pub const FED_HEADROOM_BITS: u32 = excitation::FRACTION_BITS - FED_FRACTION_BITS;

/// The next sample of Gaussian noise in the steps of a fed excitation, rounded.
#[inline]
pub(crate) fn gaussian_sample(source: &mut Excitation) -> i32 {
    const HALF: i32 = 1 << (FED_HEADROOM_BITS - 1);
    (source.next_sample() + HALF) >> FED_HEADROOM_BITS
}
