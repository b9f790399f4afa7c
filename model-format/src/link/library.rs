//! The libraries in the device and what is in them.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::Reason;
use crate::limits::{MAX_LIBRARY_BYTES, MAX_NAME_BYTES};
use crate::scene::SceneName;
use crate::{FORMAT_VERSION, MillimetresPerSecond, Newton, Provenance, Structure};

/// Name of a texture.
pub type TextureName = String<MAX_NAME_BYTES>;

/// One of the two places for a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum SlotId {
    /// The first.
    A,
    /// The second.
    B,
}

impl SlotId {
    /// Both, in order.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// 0 or 1.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The one that this is not.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

impl core::fmt::Display for SlotId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::A => "A",
            Self::B => "B",
        })
    }
}

/// Why a slot that is not empty holds no library.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum SlotFault {
    /// A flash word faults when read, as after a power cut while it was written.
    #[error("byte {offset} cannot be read, as after a power cut: upload again")]
    Unreadable {
        /// Where in the slot.
        offset: u32,
    },
    /// There is no valid header: an upload was broken off.
    #[error("an upload that was not finished: upload again")]
    Unfinished,
    /// A header of another firmware's store.
    #[error("the slot was written by another firmware (header version {found}): upload again")]
    HeaderVersion {
        /// The version in the header.
        found: u16,
    },
    /// A length that no library has.
    #[error("the header declares {length} bytes, of at most {MAX_LIBRARY_BYTES}: upload again")]
    Length {
        /// What the header says.
        length: u32,
    },
    /// The bytes are not those that were written.
    #[error("checksum {found:08x} where {expected:08x} is stored: upload again")]
    Checksum {
        /// What the header says.
        expected: u32,
        /// Of the bytes.
        found: u32,
    },
    /// The bytes are not a library that this device can play.
    #[error("not a library of format {FORMAT_VERSION} that can be played: {reason}")]
    Invalid {
        /// What the device's validator says.
        reason: Reason,
    },
}

/// A valid library in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SlotInfo {
    /// Counts uploads; the higher of two valid slots is taken at boot.
    pub sequence: u32,
    /// Length of the library, bytes.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of the library.
    pub crc32: u32,
    /// How many textures it has.
    pub textures: u8,
    /// How many scenes it has.
    pub scenes: u8,
}

/// What is in a slot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum SlotState {
    /// Nothing: it is erased.
    Empty,
    /// A library is being received into it.
    Receiving,
    /// A library.
    Valid(SlotInfo),
    /// Something else.
    Faulty(SlotFault),
}

/// Both slots.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Slots {
    /// Slot A, then slot B.
    pub slots: [SlotState; 2],
    /// The one whose library is played, if any.
    pub active: Option<SlotId>,
}

/// Asks for one texture or scene of a slot, so that a listing of any length fits in frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ListRequest {
    /// The slot.
    pub slot: SlotId,
    /// Which one, from 0 to the slot's count less one.
    pub index: u8,
}

/// A texture in a slot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct TextureInfo {
    /// Its name.
    pub name: TextureName,
    /// What its coefficients are for.
    pub structure: Structure,
    /// Where its recordings came from.
    pub provenance: Provenance,
    /// Samples a second at which its models hold.
    pub sample_rate_hz: u32,
    /// The highest order of its models.
    pub max_order: u16,
    /// How many speeds its grid has.
    pub speeds: u8,
    /// How many forces its grid has.
    pub forces: u8,
    /// Lowest and highest speed.
    pub speed_range: [MillimetresPerSecond; 2],
    /// Lowest and highest force.
    pub force_range: [Newton; 2],
    /// Nodes that are silent.
    pub silent_nodes: u16,
    /// Nodes that were filled in from others.
    pub filled_nodes: u16,
    /// Nodes from recordings with a fault.
    pub doubtful_nodes: u16,
}

/// A scene in a slot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SceneInfo {
    /// Its name.
    pub name: SceneName,
    /// How many surfaces it has.
    pub surfaces: u8,
    /// How many regions lie along its path; 0 is its first surface everywhere.
    pub regions: u8,
    /// Surfaces that answer to taps.
    pub taps: u8,
    /// Surfaces to which the tool sticks.
    pub stick_slips: u8,
    /// Sections of its equaliser.
    pub sections: u8,
    /// Whether it is played at one speed and force whatever the hand does.
    pub constant_motion: bool,
}

/// Why a texture or scene cannot be listed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum ListError {
    /// The slot holds no valid library.
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary {
        /// The slot.
        slot: SlotId,
    },
    /// There are not so many textures.
    #[error("texture {index} of slot {slot}, which has {textures}: list again")]
    Index {
        /// The slot.
        slot: SlotId,
        /// What was asked for.
        index: u8,
        /// How many there are.
        textures: u8,
    },
    /// There are not so many scenes.
    #[error("scene {index} of slot {slot}, which has {scenes}: list again")]
    SceneIndex {
        /// The slot.
        slot: SlotId,
        /// What was asked for.
        index: u8,
        /// How many there are.
        scenes: u8,
    },
    /// The slot cannot be read.
    #[error("slot {slot}: {fault}")]
    Faulty {
        /// The slot.
        slot: SlotId,
        /// Why not.
        fault: SlotFault,
    },
}

/// A library that is played from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Activated {
    /// Where it is.
    pub slot: SlotId,
    /// What it is.
    pub library: SlotInfo,
}

/// Why a library does not become the active one. The one that was active stays so, unless it is said otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum ActivateError {
    /// The slot is empty or being written.
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary {
        /// The slot.
        slot: SlotId,
    },
    /// The slot cannot be read or is not valid.
    #[error("slot {slot}: {fault}")]
    Faulty {
        /// The slot.
        slot: SlotId,
        /// Why not.
        fault: SlotFault,
    },
    /// The copy in RAM is not what is in the slot. No library is active now.
    #[error(
        "slot {slot} did not get into RAM as it is, and no library is active now: activate again"
    )]
    NotCopied {
        /// The slot.
        slot: SlotId,
    },
    /// Another activation is under way.
    #[error("another library is being activated: try again in a moment")]
    Busy,
    /// The output did not fade out in time.
    #[error("the output did not come to rest: stop it, then activate again")]
    NotAtRest,
}
