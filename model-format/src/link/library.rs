//! The two slots for libraries: their content, lists of a library's textures and scenes, the activation of a library,
//! and its upload, in chunks, so that an upload can continue where a broken link interrupted it.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::FLASH_SUPPLY_MV;
use crate::limits::{FLASH_WORD_BYTES, MAX_LIBRARY_BYTES, MAX_NAME_BYTES};
use crate::scene::SceneName;
use crate::{FORMAT_VERSION, MillimetresPerSecond, Newton, Provenance};

pub use crate::wire::CRC32 as LIBRARY_CRC;

/// Request for one texture or scene of a slot. A list of any length can be read, because each frame has one entry.
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
    /// Number of regions along its path; with 0, its first surface is everywhere.
    pub regions: u8,
    /// Number of surfaces with a tap transient.
    pub taps: u8,
    /// Number of surfaces with stick-slip.
    pub stick_slips: u8,
    /// Number of sections of its equaliser.
    pub sections: u8,
    /// True if the scene is played at one speed and force, independent of the hand's motion.
    pub constant_motion: bool,
}

/// Reason for which a texture or scene cannot be listed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum ListError {
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary { slot: SlotId },
    #[error("texture {index} of slot {slot}, which has {textures}: list again")]
    Index {
        slot: SlotId,
        /// The requested index.
        index: u8,
        /// Number of the slot's textures.
        textures: u16,
    },
    #[error("scene {index} of slot {slot}, which has {scenes}: list again")]
    SceneIndex {
        slot: SlotId,
        /// The requested index.
        index: u8,
        /// Number of the slot's scenes.
        scenes: u8,
    },
    /// A slot that cannot be read.
    #[error("slot {slot}: {fault}")]
    Faulty {
        slot: SlotId,
        /// Fault of the slot.
        fault: SlotFault,
    },
}

/// The library that is active from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Activated {
    /// Slot of the library.
    pub slot: SlotId,
    /// Length, checksum and counts of the library.
    pub library: SlotInfo,
}

/// Reason for which a library does not become active. The previous library stays active, unless stated otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum ActivateError {
    #[error("slot {slot} holds no library: upload one")]
    NoLibrary { slot: SlotId },
    /// A slot that cannot be read or is not valid.
    #[error("slot {slot}: {fault}")]
    Faulty {
        slot: SlotId,
        /// Fault of the slot.
        fault: SlotFault,
    },
    #[error("the copy of slot {slot} in RAM differs from it, and no library is active now: activate again")]
    NotCopied { slot: SlotId },
    #[error("another library is being activated or settings are being stored: try again in a moment")]
    Busy,
    #[error("the output did not come to rest: stop it, then activate again")]
    NotAtRest,
}

/// One of the two slots for a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum SlotId {
    /// The first slot.
    A,
    /// The second slot.
    B,
}

impl SlotId {
    /// Both slots, in order.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// Index of the slot, 0 or 1.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The slot that is not this one.
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

/// Reason for which a slot that is not empty holds no library.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum SlotFault {
    #[error("byte {offset} cannot be read, as after a power cut: upload again")]
    Unreadable {
        /// Byte of the slot.
        offset: u32,
    },
    #[error("an upload that was not finished: upload again")]
    Unfinished,
    #[error("the slot was written by another firmware (header version {found}): upload again")]
    HeaderVersion {
        /// Version in the header.
        found: u16,
    },
    #[error("the header declares {length} bytes, of at most {MAX_LIBRARY_BYTES}: upload again")]
    Length {
        /// Length in the header, bytes.
        length: u32,
    },
    #[error("checksum {found:08x} where {expected:08x} is stored: upload again")]
    Checksum {
        /// CRC-32 in the header.
        expected: u32,
        /// CRC-32 of the bytes.
        found: u32,
    },
    #[error("not a library of format {FORMAT_VERSION} that can be played: {reason}")]
    Invalid {
        /// Message of the device's validator.
        reason: Reason,
    },
}

/// A valid library in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SlotInfo {
    /// Number of the upload, which wraps around. At boot, the valid slot with the later number becomes active.
    pub sequence: u32,
    /// Length of the library, bytes.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of the library.
    pub crc32: u32,
    /// Number of its textures.
    pub textures: u16,
    /// Number of its scenes.
    pub scenes: u8,
}

/// Content of a slot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum SlotState {
    /// Nothing: the slot is erased.
    Empty,
    /// A library that is being received.
    Receiving,
    /// A library.
    Valid(SlotInfo),
    /// No library, for this reason.
    Faulty(SlotFault),
}

/// Content of both slots.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Slots {
    /// Slot A, then slot B.
    pub slots: [SlotState; 2],
    /// The slot whose library is played, if any.
    pub active: Option<SlotId>,
}

/// Name of a texture.
pub type TextureName = String<MAX_NAME_BYTES>;

/// Reason of a fault, as text for a person.
pub type Reason = String<160>;

/// Largest number of bytes in a chunk.
pub const MAX_CHUNK_BYTES: usize = 512;

/// The length of every chunk except the last is a multiple of this number of bytes, which is a flash word.
pub const CHUNK_ALIGN: usize = FLASH_WORD_BYTES;

/// Largest number of chunks that a host sends before it has the answer to the first of them.
///
/// While the device programs one chunk, the next chunks are transferred, so that the device never waits for the link.
/// The device's queue is longer than this number, so that requests of another link fit in it too.
pub const UPLOAD_WINDOW: usize = 3;

/// Request to receive a library into the slot that is not active.
///
/// If length and checksum are those of an interrupted upload, the request resumes that upload, as long as the device
/// has not restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadBegin {
    /// Length of the library, bytes.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of all the library's bytes.
    pub crc32: u32,
    /// True if the upload may erase the last readable library. The device then has no library until the upload is
    /// committed.
    pub replaces_last: bool,
}

/// A chunk of a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadChunk<'a> {
    /// Byte of the library at which the chunk begins; must be the next offset that the device expects.
    pub offset: u32,
    /// Bytes of the chunk, at most [`MAX_CHUNK_BYTES`]; a multiple of [`CHUNK_ALIGN`] unless the chunk is the last.
    pub data: &'a [u8],
}

/// Progress of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadProgress {
    /// The upload that was begun.
    pub upload: UploadBegin,
    /// The slot that receives the upload.
    pub slot: SlotId,
    /// Byte at which the next chunk must begin; the library's length once all chunks have arrived.
    pub next_offset: u32,
}

/// State of the upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum UploadState {
    /// No upload is under way.
    Idle,
    /// An upload is under way, and can be resumed from its next offset.
    Receiving(UploadProgress),
}

/// An uploaded library that was read back from flash and is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadCommitted {
    /// Slot of the library.
    pub slot: SlotId,
    /// Sequence number of the library, above that of every other library in the device.
    pub sequence: u32,
    /// Number of textures in the library.
    pub textures: u16,
}

/// An operation of the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum FlashOperation {
    /// Reading.
    Read,
    /// Erasing a sector.
    Erase,
    /// Programming words.
    Write,
}

impl core::fmt::Display for FlashOperation {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Read => "reading",
            Self::Erase => "erasing",
            Self::Write => "writing",
        })
    }
}

/// Reason for which an upload does not continue. The active library stays as it is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum UploadError {
    #[error("a library of {length} bytes; a slot holds 1 to {MAX_LIBRARY_BYTES}: fit fewer textures or lower orders")]
    Length {
        /// Announced length, bytes.
        length: u32,
    },
    #[error("no upload is under way: begin one")]
    NotBegun,
    #[error("a chunk at byte {found} where byte {expected} is due: go on from there")]
    Offset {
        /// Byte at which the next chunk must begin.
        expected: u32,
        /// Byte at which the received chunk begins.
        found: u32,
    },
    #[error("a chunk of {length} bytes; send 1 to {MAX_CHUNK_BYTES}, multiples of {CHUNK_ALIGN} before the end")]
    ChunkLength {
        /// Length of the chunk, bytes.
        length: u32,
    },
    #[error("a chunk up to byte {end} of a library of {length} bytes: begin again with the right length")]
    PastEnd {
        /// Byte of the library at which the chunk ends.
        end: u32,
        /// Announced length, bytes.
        length: u32,
    },
    #[error("{next_offset} of {length} bytes have arrived: send the rest first")]
    Incomplete {
        /// Number of bytes that have arrived.
        next_offset: u32,
        /// Announced length, bytes.
        length: u32,
    },
    #[error("checksum {found:08x} where {expected:08x} was announced: upload again")]
    Checksum {
        /// Announced CRC-32.
        expected: u32,
        /// CRC-32 of the bytes in flash.
        found: u32,
    },
    #[error("not a library that this device can play: {reason}")]
    Invalid {
        /// Message of the device's validator.
        reason: Reason,
    },
    #[error("byte {offset} of slot {slot} reads back wrong: upload again; if it stays, the flash is worn")]
    ReadBack {
        slot: SlotId,
        /// Byte of the slot.
        offset: u32,
    },
    #[error("a fault while {operation} slot {slot} at byte {offset}: upload again; if it stays, the flash is worn")]
    Flash {
        slot: SlotId,
        /// The operation that failed.
        operation: FlashOperation,
        /// Byte of the slot.
        offset: u32,
    },
    #[error(
        "slot {slot} holds the only library that can be read, and an upload would erase it: activate slot {slot}, \
         which leaves the other one to the upload, or upload with --replace-last"
    )]
    LastLibrary { slot: SlotId },
    #[error("a library is being activated, or an update is not confirmed: try again in a minute")]
    Busy,
    #[error("the supply is below {FLASH_SUPPLY_MV} mV, too low to write flash: see to the supply, then upload again")]
    SupplyLow,
}
