//! The motion that the host gives.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::{MillimetresPerSecond, Newton};

/// What the hand does at a moment, as the host knows it. Sent at up to 1 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct MotionSample {
    /// Tangential speed; its sign does not matter.
    pub speed: MillimetresPerSecond,
    /// Normal force; below zero is no contact.
    pub force: Newton,
    /// The place on the path of a scene, mm from where playing began; none leaves it to the device's encoder.
    pub position_mm: Option<f32>,
    /// Whether the tool touches; none leaves it to the force.
    pub contact: Option<bool>,
}

/// Why a motion is not followed. The one before stays until it is stale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum MotionRefused {
    /// The speed is NaN or infinite.
    #[error("the speed is not finite: send a number of mm/s")]
    Speed,
    /// The force is NaN or infinite.
    #[error("the force is not finite: send a number of N")]
    Force,
    /// The position is NaN or infinite.
    #[error("the position is not finite: send a number of mm, or none")]
    Position,
}
