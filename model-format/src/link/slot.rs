//! The two slots for a library, and their content.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::Reason;
use crate::FORMAT_VERSION;
use crate::limits::MAX_LIBRARY_BYTES;

pub use crate::wire::CRC32 as LIBRARY_CRC;

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

    /// The other slot.
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
pub enum SlotFault {
    /// A flash word that faults when read, as after a power cut while it was written.
    #[error("byte {offset} cannot be read, as after a power cut: upload again")]
    Unreadable {
        /// Byte of the slot.
        offset: u32,
    },
    /// No valid header, because an upload was broken off.
    #[error("an upload that was not finished: upload again")]
    Unfinished,
    /// A header of another firmware's store.
    #[error("the slot was written by another firmware (header version {found}): upload again")]
    HeaderVersion {
        /// Version in the header.
        found: u16,
    },
    /// A length that no library has.
    #[error("the header declares {length} bytes, of at most {MAX_LIBRARY_BYTES}: upload again")]
    Length {
        /// Length in the header, bytes.
        length: u32,
    },
    /// A checksum that is not that of the bytes.
    #[error("checksum {found:08x} where {expected:08x} is stored: upload again")]
    Checksum {
        /// CRC-32 in the header.
        expected: u32,
        /// CRC-32 of the bytes.
        found: u32,
    },
    /// Bytes that are not a library that this device can play.
    #[error("not a library of format {FORMAT_VERSION} that can be played: {reason}")]
    Invalid {
        /// Message of the device's validator.
        reason: Reason,
    },
}

/// A valid library in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SlotInfo {
    /// Number of the upload, which wraps. The valid slot with the later number is taken at boot.
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
