//! Header of a slot: one flash word, which is programmed at once. Its checksum shows a programming that was cut.
//!
//! **Copies.** A commit writes two such words, and a start adds another while fewer than two are whole. A word whose
//! programming was cut at its very end may read right at one start and wrong at the next, so that the newest library
//! would come and go. No number of reads proves such a word whole, but a second word does without it.

use crc::{CRC_32_ISO_HDLC, Crc};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::SlotId;
use serde::{Deserialize, Serialize};

use super::{MappedFlash, SlotStore, WORD_BYTES, address};

/// Version of the header. It changes when an older firmware could misread a newer slot.
pub const HEADER_VERSION: u16 = 1;

/// Offset of the header in its slot.
pub const HEADER_OFFSET: u32 = MAX_LIBRARY_BYTES as u32;

/// Number of times that each word of the library that stays must read the same. A word that reads right half of the
/// time passes once in a million times. For a full slot this takes about a tenth of a second, as estimated from the
/// number of loads.
pub(super) const STEADY_READS: usize = 20;

const MAGIC: [u8; 4] = *b"HTXS";
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Header of a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Number of the upload, which wraps.
    pub sequence: u32,
    /// Length of the library, bytes.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of the library's bytes.
    pub crc32: u32,
}

/// Content of a header's word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderWord {
    /// A whole header of this version.
    Header(Header),
    /// All ones.
    Blank,
    /// A whole header of another version.
    Version(u16),
    /// Anything else.
    Damaged,
}

/// The word without its checksum, all fields of fixed width.
#[derive(Serialize, Deserialize)]
struct Fields {
    magic: [u8; 4],
    #[serde(with = "postcard::fixint::le")]
    version: u16,
    #[serde(with = "postcard::fixint::le")]
    reserved: u16,
    #[serde(with = "postcard::fixint::le")]
    sequence: u32,
    #[serde(with = "postcard::fixint::le")]
    length: u32,
    #[serde(with = "postcard::fixint::le")]
    crc32: u32,
}

/// Length of [`Fields`].
const FIELD_BYTES: usize = 20;

impl Header {
    pub fn word(self) -> [u8; WORD_BYTES] {
        let fields = Fields {
            magic: MAGIC,
            version: HEADER_VERSION,
            reserved: 0,
            sequence: self.sequence,
            length: self.length,
            crc32: self.crc32,
        };
        let mut word = [0; WORD_BYTES];
        postcard::to_slice(&fields, &mut word[..FIELD_BYTES]).expect("fields of fixed width fit their length");
        let crc = CRC.checksum(&word[..FIELD_BYTES]);
        word[FIELD_BYTES..][..4].copy_from_slice(&crc.to_le_bytes());
        word
    }

    pub fn read(word: &[u8; WORD_BYTES]) -> HeaderWord {
        if *word == [0xff; WORD_BYTES] {
            return HeaderWord::Blank;
        }
        let crc = CRC.checksum(&word[..FIELD_BYTES]);
        let Ok(fields) = postcard::from_bytes::<Fields>(&word[..FIELD_BYTES]) else {
            return HeaderWord::Damaged;
        };
        if fields.magic != MAGIC || word[FIELD_BYTES..][..4] != crc.to_le_bytes() {
            return HeaderWord::Damaged;
        }
        if fields.version != HEADER_VERSION {
            return HeaderWord::Version(fields.version);
        }
        HeaderWord::Header(Self {
            sequence: fields.sequence,
            length: fields.length,
            crc32: fields.crc32,
        })
    }
}

/// Number of words that hold a header.
const COPIES: usize = 2;

/// The header of a slot, as its words show it.
pub(super) struct Copies {
    /// Content of a word with a header, or else of the first word; none if the first word cannot be read.
    pub(super) word: Option<HeaderWord>,
    /// Number of words that hold a header at each of [`STEADY_READS`] reads.
    pub(super) whole: usize,
    /// Offset of the first word that was never written.
    next: u32,
}

impl Copies {
    /// The header, if a read of any word has found it.
    pub(super) fn header(&self) -> Option<Header> {
        match self.word {
            Some(HeaderWord::Header(header)) => Some(header),
            _ => None,
        }
    }
}

impl<F: MappedFlash> SlotStore<F> {
    /// Reads the words of the header of `slot`, each [`STEADY_READS`] times. A header that one read finds was written,
    /// because its checksum is right.
    pub(super) async fn copies(&mut self, slot: SlotId) -> Copies {
        let mut copies = Copies {
            word: None,
            whole: 0,
            next: HEADER_OFFSET,
        };
        while copies.next < SLOT_BYTES as u32 {
            let [mut right, mut blank] = [0; 2];
            for _ in 0..STEADY_READS {
                let word = self.word(slot, copies.next).await;
                let word = word.map(|word| Header::read(&word));
                let is_header = matches!(word, Some(HeaderWord::Header(_)));
                if is_header || copies.next == HEADER_OFFSET && copies.header().is_none() {
                    copies.word = word;
                }
                right += usize::from(is_header);
                blank += usize::from(word == Some(HeaderWord::Blank));
            }
            if blank == STEADY_READS {
                break;
            }
            copies.whole += usize::from(right == STEADY_READS);
            copies.next += WORD_BYTES as u32;
        }
        copies
    }

    /// Writes `header` into a further word of `slot`, unless enough words hold it. Words that do not take it are passed
    /// over.
    pub(super) async fn renew(&mut self, slot: SlotId, header: Header, copies: &Copies) {
        if copies.whole >= COPIES {
            return;
        }
        let word = header.word();
        for offset in (copies.next..SLOT_BYTES as u32).step_by(WORD_BYTES) {
            let written = self.flash.write(address(slot, offset), &word).await.is_ok();
            if written && self.word(slot, offset).await == Some(word) {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_header_comes_back_and_a_changed_bit_is_seen(
            sequence: u32, length: u32, crc32: u32, bit in 0..(FIELD_BYTES + 4) * 8,
        ) {
            let header = Header { sequence, length, crc32 };
            let mut word = header.word();
            prop_assert_eq!(Header::read(&word), HeaderWord::Header(header));
            word[bit / 8] ^= 1 << (bit % 8);
            prop_assert_eq!(Header::read(&word), HeaderWord::Damaged);
        }
    }

    #[test]
    fn a_header_of_another_version_is_told_from_damage() {
        let mut word = Header {
            sequence: 1,
            length: 2,
            crc32: 3,
        }
        .word();
        word[4] += 1;
        let crc = CRC.checksum(&word[..FIELD_BYTES]);
        word[FIELD_BYTES..][..4].copy_from_slice(&crc.to_le_bytes());
        assert_eq!(Header::read(&word), HeaderWord::Version(HEADER_VERSION + 1));
        assert_eq!(Header::read(&[0xff; WORD_BYTES]), HeaderWord::Blank);
    }
}
