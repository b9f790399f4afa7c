//! What the hand does with the tool, as a scene follows it.

use crate::grid::Motion;

/// Motion, place and contact at a moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// Speed and force.
    pub motion: Motion,
    position_mm: f32,
    /// Whether the tool touches.
    pub contact: bool,
}

/// A place that no sensor should give: it is NaN or infinite.
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

    /// A motion at a place on the path, mm from its origin.
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

    /// A motion in contact at the path's origin: all that a scene of one surface without effects needs.
    pub const fn touching(motion: Motion) -> Self {
        Self {
            motion,
            position_mm: 0.0,
            contact: true,
        }
    }

    /// The place on the path, mm.
    pub fn position_mm(&self) -> f32 {
        self.position_mm
    }
}

/// Tells contact from a force that is never quite zero: it begins above one force and ends below a lower one, so that noise
/// around either makes no taps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactDetector {
    touching: bool,
}

impl ContactDetector {
    /// Force from which on the tool touches, N.
    pub const BEGINS_N: f32 = 0.02;

    /// Force up to which it does not any more, N.
    pub const ENDS_N: f32 = 0.01;

    /// Not touching.
    pub const fn new() -> Self {
        Self { touching: false }
    }

    /// Whether the tool touches, now that the force is that of `motion`.
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
