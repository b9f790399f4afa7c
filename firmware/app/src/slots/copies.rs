//! The copies of a slot's header: a commit writes two words, and a start adds another while fewer than two are whole.
//!
//! A word whose programming was cut at its very end may read right at one start and wrong at the next, so that the
//! newest library would come and go. No number of reads proves such a word whole, but a second word does without it.

use model_format::limits::SLOT_BYTES;
use model_format::link::SlotId;

use super::claim::STEADY_READS;
use super::header::{HEADER_OFFSET, Header, HeaderWord};
use super::{MappedFlash, SlotStore, WORD_BYTES, address};

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
