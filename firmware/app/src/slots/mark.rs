//! Result of a proof, and its mark: a flash word after a slot's header. It says that this device has proved the direct
//! forms of the slot's library.
//!
//! Only the device writes it: no byte of an upload reaches that part of a slot, and the erasure that begins an upload
//! takes it away. It holds the proof's version, so that another version proves again, into the next free word.

use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc};
use model_format::limits::SLOT_BYTES;
use model_format::link::SlotFault;
use stylus_kernel::proof::PROOF_VERSION;

use super::header::HEADER_OFFSET;
use crate::flash::WORD_BYTES;

const MAGIC: [u8; 4] = *b"HTXP";
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Offsets in the slot of the words that may hold a mark.
pub(super) const MARK_OFFSETS: Range<u32> = HEADER_OFFSET + WORD_BYTES as u32..SLOT_BYTES as u32;

/// Result of a proof that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Proved {
    /// There is nothing to prove.
    NotNeeded,
    /// All direct forms are stable.
    Stable,
}

/// Reason for which a library was not proved.
#[derive(Debug)]
pub(crate) enum NotProved {
    /// A fault of the slot or the library.
    Fault(SlotFault),
    /// The proof was called off.
    CalledOff,
}

impl From<SlotFault> for NotProved {
    fn from(fault: SlotFault) -> Self {
        Self::Fault(fault)
    }
}

/// The mark of a library of this length and checksum.
pub(super) fn mark_of(length: u32, crc32: u32) -> [u8; WORD_BYTES] {
    let mut word = [0; WORD_BYTES];
    word[..4].copy_from_slice(&MAGIC);
    word[4..6].copy_from_slice(&PROOF_VERSION.to_le_bytes());
    word[8..12].copy_from_slice(&length.to_le_bytes());
    word[12..16].copy_from_slice(&crc32.to_le_bytes());
    let crc = CRC.checksum(&word[..16]);
    word[16..20].copy_from_slice(&crc.to_le_bytes());
    word
}
