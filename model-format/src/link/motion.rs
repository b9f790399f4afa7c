//! Motion sent by the host.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::LinkId;
use crate::{MillimetresPerSecond, Newton};

/// Motion of the tool at a moment, as the host knows it. It is sent at up to 1 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct MotionSample {
    /// Tangential speed. Its sign matters to lines that are locked to place alone, and only without positions.
    pub speed: MillimetresPerSecond,
    /// Normal force; a negative one is no contact.
    pub force: Newton,
    /// Position on the path of a scene, mm from where playing began; none leaves it to the device's encoder. Lines that
    /// are locked to place follow it too; none leaves them to the speed.
    pub position_mm: Option<f32>,
    /// Contact of the tool; none leaves it to the force.
    pub contact: Option<bool>,
}

/// Reason for which a motion is not followed. The one before stays until it is stale.
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
    /// The other link plays, and it alone moves what it plays.
    #[error("{by} plays, and it alone gives the motion: stop it first")]
    Held {
        /// The link that plays.
        by: LinkId,
    },
}
