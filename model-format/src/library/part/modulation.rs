//! Part of kind 4: a track of the excitation's level, from which its slow changes are pieced together.

use alloc::vec::Vec;

/// Level track of a texture, with a mean squared amplitude of 1.
#[derive(Clone, Debug, PartialEq)]
pub struct ModulationSpec {
    /// Samples from one entry to the next.
    pub step_samples: u16,
    /// Levels of the excitation, in steps of 0.25 dB.
    pub entries: Vec<i8>,
}
