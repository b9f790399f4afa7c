//! Listing the textures and scenes of a slot, and activating its library.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{SlotFault, SlotId, SlotInfo, TextureName};
use crate::scene::SceneName;
use crate::{MillimetresPerSecond, Newton, Provenance};

/// Request for one texture or scene of a slot. A listing of any length fits in frames, because each has one entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ListRequest {
    /// The slot.
    pub slot: SlotId,
    /// Index of the texture or scene, below the slot's count.
    pub index: u8,
}

/// A texture in a slot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct TextureInfo {
    /// Name of the texture.
    pub name: TextureName,
    /// Origin of its recordings.
    pub provenance: Provenance,
    /// Sample rate of its models, Hz.
    pub sample_rate_hz: u32,
    /// Highest order of its models.
    pub max_order: u16,
    /// Number of speeds of its grid.
    pub speeds: u8,
    /// Number of forces of its grid.
    pub forces: u8,
    /// Lowest and highest speed.
    pub speed_range: [MillimetresPerSecond; 2],
    /// Lowest and highest force.
    pub force_range: [Newton; 2],
    /// Number of silent nodes.
    pub silent_nodes: u16,
    /// Number of nodes that were filled from others.
    pub filled_nodes: u16,
    /// Number of nodes from recordings with a fault.
    pub doubtful_nodes: u16,
}

/// A scene in a slot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SceneInfo {
    /// Name of the scene.
    pub name: SceneName,
    /// Number of its surfaces.
    pub surfaces: u8,
    /// Number of regions along its path; 0 is its first surface everywhere.
    pub regions: u8,
    /// Number of surfaces with a tap transient.
    pub taps: u8,
    /// Number of surfaces with stick-slip.
    pub stick_slips: u8,
    /// Number of sections of its equaliser.
    pub sections: u8,
    /// True if it is played at one speed and force, whatever the hand does.
    pub constant_motion: bool,
}

/// Reason for which a texture or scene cannot be listed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum ListError {
    /// A slot without a valid library.
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary {
        /// The slot.
        slot: SlotId,
    },
    /// An index beyond the last texture.
    #[error("texture {index} of slot {slot}, which has {textures}: list again")]
    Index {
        /// The slot.
        slot: SlotId,
        /// The requested index.
        index: u8,
        /// Number of the slot's textures.
        textures: u16,
    },
    /// An index beyond the last scene.
    #[error("scene {index} of slot {slot}, which has {scenes}: list again")]
    SceneIndex {
        /// The slot.
        slot: SlotId,
        /// The requested index.
        index: u8,
        /// Number of the slot's scenes.
        scenes: u8,
    },
    /// A slot that cannot be read.
    #[error("slot {slot}: {fault}")]
    Faulty {
        /// The slot.
        slot: SlotId,
        /// Fault of the slot.
        fault: SlotFault,
    },
}

/// The library that is active from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Activated {
    /// Its slot.
    pub slot: SlotId,
    /// Length, checksum and counts of it.
    pub library: SlotInfo,
}

/// Reason for which a library does not become active. The one that was active stays so, unless stated otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum ActivateError {
    /// A slot that is empty or being written.
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary {
        /// The slot.
        slot: SlotId,
    },
    /// A slot that cannot be read or is not valid.
    #[error("slot {slot}: {fault}")]
    Faulty {
        /// The slot.
        slot: SlotId,
        /// Fault of the slot.
        fault: SlotFault,
    },
    /// A copy in RAM that differs from the slot. No library is active now.
    #[error(
        "the copy of slot {slot} in RAM differs from it, and no library is active now: activate again"
    )]
    NotCopied {
        /// The slot.
        slot: SlotId,
    },
    /// Another activation is under way, or settings are being stored.
    #[error(
        "another library is being activated or settings are being stored: try again in a moment"
    )]
    Busy,
    /// The output did not fade out in time.
    #[error("the output did not come to rest: stop it, then activate again")]
    NotAtRest,
}
