//! Carrying a library to the device, in chunks, so that a broken link costs no more than a chunk.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::SlotId;
use crate::limits::MAX_LIBRARY_BYTES;

/// Most bytes in a chunk.
pub const MAX_CHUNK_BYTES: usize = 512;

/// Every chunk but the last is a multiple of this long, bytes: the flash word of the STM32H743 (RM0433 section 4.3.9).
pub const CHUNK_ALIGN: usize = 32;

/// The CRC-32 of a whole library, as announced before an upload and kept in a slot.
pub static LIBRARY_CRC: crc::Crc<u32> = crate::wire::CRC32;

/// Words for a person.
pub type Reason = String<160>;

/// Asks to receive a library into the slot that is not active.
///
/// The same length and checksum as an upload that was broken off, in the same session of the device, resume it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadBegin {
    /// Length of the library, bytes.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of all its bytes.
    pub crc32: u32,
}

/// Bytes of a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadChunk<'a> {
    /// Where they begin; must be the next offset that the device expects.
    pub offset: u32,
    /// The bytes, at most [`MAX_CHUNK_BYTES`], a multiple of [`CHUNK_ALIGN`] unless they are the last.
    pub data: &'a [u8],
}

/// How far an upload has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadProgress {
    /// What was begun.
    pub upload: UploadBegin,
    /// Where it goes.
    pub slot: SlotId,
    /// Where the next chunk must begin; the length when all is there.
    pub next_offset: u32,
}

/// Whether an upload is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum UploadState {
    /// None is.
    Idle,
    /// One is, and can be resumed from its next offset.
    Receiving(UploadProgress),
}

/// A library that is in flash, read back and valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UploadCommitted {
    /// Where it is.
    pub slot: SlotId,
    /// Its sequence number, above that of every other library in the device.
    pub sequence: u32,
    /// How many textures it has.
    pub textures: u8,
}

/// What the flash was asked to do.
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

/// Why an upload does not go on. The library that is active is never touched by it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum UploadError {
    /// A library that is empty or does not fit a slot.
    #[error(
        "a library of {length} bytes; a slot holds 1 to {MAX_LIBRARY_BYTES}: fit fewer textures or lower orders"
    )]
    Length {
        /// What was announced.
        length: u32,
    },
    /// A chunk or a commit without a begin.
    #[error("no upload is under way: begin one")]
    NotBegun,
    /// A chunk out of turn.
    #[error("a chunk at byte {found} where byte {expected} is due: go on from there")]
    Offset {
        /// Where the next chunk must begin.
        expected: u32,
        /// Where this one does.
        found: u32,
    },
    /// A chunk that is empty, too long, or of an odd length before the end.
    #[error(
        "a chunk of {length} bytes; send 1 to {MAX_CHUNK_BYTES}, multiples of {CHUNK_ALIGN} before the end"
    )]
    ChunkLength {
        /// Its length.
        length: u32,
    },
    /// A chunk that goes past the announced length.
    #[error(
        "a chunk up to byte {end} of a library of {length} bytes: begin again with the right length"
    )]
    PastEnd {
        /// Where it ends.
        end: u32,
        /// What was announced.
        length: u32,
    },
    /// A commit before the last chunk.
    #[error("{next_offset} of {length} bytes have arrived: send the rest first")]
    Incomplete {
        /// How many are there.
        next_offset: u32,
        /// What was announced.
        length: u32,
    },
    /// The bytes in flash are not those that were announced.
    #[error("checksum {found:08x} where {expected:08x} was announced: upload again")]
    Checksum {
        /// What was announced.
        expected: u32,
        /// Of the bytes in flash.
        found: u32,
    },
    /// The bytes are not a library that this device can play.
    #[error("not a library that this device can play: {reason}")]
    Invalid {
        /// What the device's validator says.
        reason: Reason,
    },
    /// The flash did not keep what was written.
    #[error(
        "byte {offset} of slot {slot} reads back wrong: upload again; if it stays, the flash is worn"
    )]
    ReadBack {
        /// The slot.
        slot: SlotId,
        /// Where in it.
        offset: u32,
    },
    /// The flash reported a fault.
    #[error(
        "a fault while {operation} slot {slot} at byte {offset}: upload again; if it stays, the flash is worn"
    )]
    Flash {
        /// The slot.
        slot: SlotId,
        /// What was done.
        operation: FlashOperation,
        /// Where in the slot.
        offset: u32,
    },
    /// The library in the other slot is being activated.
    #[error("a library is being activated: try again in a moment")]
    Busy,
}
