//! Interaction of the tool with a scene: motion, position and contact.

use model_format::Newton;

use crate::grid::Motion;
use crate::position::Position;

/// Motion, position and contact at a moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// Speed and force.
    pub motion: Motion,
    position_mm: f32,
    /// Position at the last sample of the block that is decided; none if it is not known.
    position: Option<Position>,
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
        position: None,
        contact: false,
    };

    /// An interaction with `motion` at a position on the path, mm from its origin. Lines that are tied to position
    /// follow this position, too, unless [`Interaction::reaching`] sets a better one.
    pub fn new(motion: Motion, position_mm: f32, contact: bool) -> Result<Self, InteractionError> {
        if !position_mm.is_finite() {
            return Err(InteractionError);
        }
        Ok(Self {
            motion,
            position_mm,
            position: Some(Position::from_mm(position_mm)),
            contact,
        })
    }

    /// A motion in contact at the path's origin, which is all that a plan of one surface needs while the tool touches.
    pub const fn touching(motion: Motion) -> Self {
        Self {
            motion,
            position_mm: 0.0,
            position: None,
            contact: true,
        }
    }

    /// The interaction of a tool that will be at `position` at the last sample of the block that is decided. Lines that
    /// are tied to position follow it; without one they advance by the speed.
    #[must_use]
    pub const fn reaching(self, position: Option<Position>) -> Self {
        Self { position, ..self }
    }

    /// Position at the last sample of the block that is decided, if it is known.
    pub const fn position(&self) -> Option<Position> {
        self.position
    }

    /// Position on the path, mm.
    pub fn position_mm(&self) -> f32 {
        self.position_mm
    }
}

/// Force above which contact begins. It ends at and below half of that, so that noise around either bound neither ends
/// contact nor causes taps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactThreshold {
    begins_n: f32,
}

impl ContactThreshold {
    /// Threshold for forces without noise, such as those of a file, and the lowest that is derived from a sensor's
    /// noise.
    ///
    /// It is below the lightest force that a hand holds on purpose, and above a cable's weight or a slight zero drift.
    pub const LEAST: Self = Self { begins_n: 0.02 };

    /// A threshold at `force`, which must be finite.
    pub const fn new(force: Newton) -> Self {
        Self {
            begins_n: force.0.max(0.0),
        }
    }

    /// Force above which contact begins, N.
    pub const fn begins_n(self) -> f32 {
        self.begins_n
    }

    /// Force at and below which contact ends, N.
    pub const fn ends_n(self) -> f32 {
        self.begins_n / 2.0
    }
}

/// Detector of contact, from a force that is never quite zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactDetector {
    touching: bool,
}

impl ContactDetector {
    /// A detector without contact.
    pub const fn new() -> Self {
        Self { touching: false }
    }

    /// Follows the force of `motion`, and returns whether the tool touches.
    pub fn touches(&mut self, motion: Motion, threshold: ContactThreshold) -> bool {
        let bound = if self.touching {
            threshold.ends_n()
        } else {
            threshold.begins_n()
        };
        self.touching = motion.force_n() > bound;
        self.touching
    }
}
