//! One copy of the settings: a log of records in sectors of its own. The last record counts.

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

use super::record::{Place, RECORD_BYTES, Record, is_blank};
use crate::flash::WORD_BYTES;

/// Number of places that are tried for one record before its write fails. A place fails if a power loss has left a word
/// in it that reads as blank and cannot be programmed.
const TRIES: usize = 4;

/// Number of times that a place is read. A record that any of these reads finds was written, because its checksum is
/// right. Other reads may miss it, because a power loss can leave a word that reads differently each time.
const READS: usize = 16;

/// Bytes of two reads of a place, for comparison. The store holds them, because memory for tasks is scarce.
pub type Buffers = [[u8; RECORD_BYTES]; 2];

/// One copy, and what was found in it.
pub struct Copy {
    range: Range<u32>,
    /// The next place to write to.
    next: u32,
    /// The last record that can be read.
    pub newest: Option<Record>,
    /// Number of places that hold something else, after that record or, without one, in the whole copy.
    pub damaged: usize,
    /// True if that record reads differently from read to read.
    pub is_uncertain: bool,
}

impl Copy {
    /// A copy in `range`, which is of whole sectors.
    pub const fn new(range: Range<u32>) -> Self {
        Self {
            next: range.start,
            range,
            newest: None,
            damaged: 0,
            is_uncertain: false,
        }
    }

    /// Returns true if nothing was ever written.
    pub fn is_blank(&self) -> bool {
        self.newest.is_none() && self.damaged == 0
    }

    /// Returns true if a record can be read and no other one was written after it.
    pub fn is_clean(&self) -> bool {
        self.newest.is_some() && self.damaged == 0
    }

    /// Reads the copy from its end back to the last record that can be read. The places from there on, and the first
    /// ones after the end, are read [`READS`] times.
    pub async fn read<F: NorFlash>(&mut self, flash: &mut F, buffers: &mut Buffers) {
        let places = self.range.clone().step_by(RECORD_BYTES);
        let mut end = self.range.start;
        // From the end, because a place before the last record may read as blank. One read is enough here: the next
        // places that seem blank are read again below.
        for at in places.rev() {
            let [bytes, _] = buffers;
            read_once(flash, at, bytes).await;
            if !is_blank(bytes) {
                end = at + RECORD_BYTES as u32;
                break;
            }
        }
        self.next = end;
        for at in (end..self.range.end).step_by(RECORD_BYTES).take(TRIES) {
            if !reads_steadily(flash, at, buffers).await || !is_blank(&buffers[0]) {
                self.damaged += 1;
                self.next = at + RECORD_BYTES as u32;
            }
        }
        for at in (self.range.start..end).step_by(RECORD_BYTES).rev() {
            let is_steady = reads_steadily(flash, at, buffers).await;
            match Place::read(&buffers[0]) {
                Place::Blank if is_steady => {}
                Place::Record(record) => self.newest = Some(record),
                Place::Blank | Place::Damaged => self.damaged += 1,
            }
            if self.newest.is_some() {
                self.is_uncertain = !is_steady;
                break;
            }
        }
    }

    /// Writes `record` to the next place that reads back right, of at most [`TRIES`]. Returns false if none does, or if
    /// the copy is full.
    pub async fn append<F: NorFlash>(&mut self, flash: &mut F, record: &Record, buffers: &mut Buffers) -> bool {
        for _ in 0..TRIES {
            let at = self.next;
            if at >= self.range.end {
                return false;
            }
            // Counted as used before the write, because a word cannot be programmed twice.
            self.next = at + RECORD_BYTES as u32;
            buffers[0] = record.bytes();
            // If a word fails, its place counts as damaged, and the next place is tried.
            if flash.write(at, &buffers[0]).await.is_ok()
                && reads_steadily(flash, at, buffers).await
                && buffers[0] == record.bytes()
            {
                return true;
            }
        }
        false
    }

    /// Returns true if there is room for a record, with all places that may be tried for it.
    pub fn has_room(&self) -> bool {
        self.next + (TRIES * RECORD_BYTES) as u32 <= self.range.end
    }

    /// Makes the copy count as full, so that it is erased before its next record.
    pub fn count_as_full(&mut self) {
        self.next = self.range.end;
    }

    /// Erases the copy; false if the flash fails. It then counts as full, so that the next change erases it again.
    pub async fn erase<F: NorFlash>(&mut self, flash: &mut F) -> bool {
        let Range { start, end } = self.range;
        let is_erased = flash.erase(start, end).await.is_ok();
        self.next = if is_erased { start } else { end };
        is_erased
    }
}

/// Reads the place at `at` [`READS`] times. Returns false unless all reads find the same. The first buffer then holds a
/// read with a record, if there was one.
async fn reads_steadily<F: NorFlash>(flash: &mut F, at: u32, buffers: &mut Buffers) -> bool {
    let [found, other] = buffers;
    read_once(flash, at, found).await;
    let mut is_steady = true;
    for _ in 1..READS {
        read_once(flash, at, other).await;
        if other != found {
            is_steady = false;
            if matches!(Place::read(other), Place::Record(_)) {
                found.copy_from_slice(other);
            }
        }
    }
    is_steady
}

/// Reads the place at `at` once. If a word of it faults, `bytes` are zeros, which are no record.
async fn read_once<F: NorFlash>(flash: &mut F, at: u32, bytes: &mut [u8; RECORD_BYTES]) {
    let mut offset = at;
    for word in bytes.chunks_exact_mut(WORD_BYTES) {
        if flash.read(offset, word).await.is_err() {
            bytes.fill(0);
            return;
        }
        offset += WORD_BYTES as u32;
    }
}
