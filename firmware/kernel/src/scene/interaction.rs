//! Interaction of the tool with a scene: motion, position and contact.

use crate::grid::Motion;

/// Motion, position and contact at a moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// Speed and force.
    pub motion: Motion,
    position_mm: f32,
    /// True while the tool touches.
    pub contact: bool,
}

/// A position that is NaN or infinite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InteractionError;

impl core::fmt::Display for InteractionError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the position is not finite")
    }
}

impl core::error::Error for InteractionError {}

impl Interaction {
    /// No motion and no contact.
    pub const NONE: Self = Self {
        motion: Motion::REST,
        position_mm: 0.0,
        contact: false,
    };

    /// An interaction with `motion` at a position on the path, mm from its origin.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn new(motion: Motion, position_mm: f32, contact: bool) -> Result<Self, InteractionError> {
        if !position_mm.is_finite() {
            return Err(InteractionError);
        }
        Ok(Self {
            motion,
            position_mm,
            contact,
        })
    }

    /// A motion in contact at the path's origin, which is all that a scene of one surface without effects needs.
    pub const fn touching(motion: Motion) -> Self {
        Self {
            motion,
            position_mm: 0.0,
            contact: true,
        }
    }

    /// Position on the path, mm.
    pub fn position_mm(&self) -> f32 {
        self.position_mm
    }
}

/// Detector of contact, from a force that is never quite zero. Contact begins above one force and ends below a lower
/// one, so that noise around either causes no taps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactDetector {
    touching: bool,
}

impl ContactDetector {
    /// Force above which contact begins, N.
    pub const BEGINS_N: f32 = 0.02;

    /// Force at and below which contact ends, N.
    pub const ENDS_N: f32 = 0.01;

    /// A detector without contact.
    pub const fn new() -> Self {
        Self { touching: false }
    }

    /// Follows the force of `motion`, and returns whether the tool touches.
    pub fn touches(&mut self, motion: Motion) -> bool {
        let bound = if self.touching {
            Self::ENDS_N
        } else {
            Self::BEGINS_N
        };
        self.touching = motion.force_n() > bound;
        self.touching
    }
}
