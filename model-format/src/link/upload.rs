//! Upload of a library to the device, in chunks, so that an upload can continue where a broken link interrupted it.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{FLASH_SUPPLY_MV, Reason, SlotId};
use crate::limits::{FLASH_WORD_BYTES, MAX_LIBRARY_BYTES};

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
