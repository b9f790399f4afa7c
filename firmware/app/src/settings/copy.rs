//! One copy of the settings: a log of records in sectors of its own, of which the last one counts.

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

use super::record::{Place, RECORD_BYTES, Record};
use crate::flash::WORD_BYTES;

/// Places that are tried for one record before the copy counts as full. A place fails if a power cut has left a word of
/// it that reads as blank and cannot be programmed.
const TRIES: usize = 4;

/// Reads of a place that must agree.
const READS: usize = 16;

/// Content of a copy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Content {
    /// The last record that can be read.
    pub newest: Option<Record>,
    /// Number of places after it, or at all, that hold something else.
    pub damaged: usize,
}

impl Content {
    /// Returns true if nothing was ever written.
    pub fn is_blank(&self) -> bool {
        self.newest.is_none() && self.damaged == 0
    }

    /// Returns true if no record was written after the one that can be read.
    pub fn is_clean(&self) -> bool {
        self.newest.is_some() && self.damaged == 0
    }
}

/// One copy.
pub struct Copy {
    range: Range<u32>,
    /// The next place to write to.
    next: u32,
}

impl Copy {
    /// A copy in `range`, which is of whole sectors.
    pub const fn new(range: Range<u32>) -> Self {
        let next = range.start;
        Self { range, next }
    }

    /// Reads the copy, from its end back to the last record that can be read.
    ///
    /// The places around the end are read often, because a word after a power cut may differ from read to read.
    pub async fn read<F: NorFlash>(&mut self, flash: &mut F) -> Content {
        let mut content = Content {
            newest: None,
            damaged: 0,
        };
        let places = self.range.clone().step_by(RECORD_BYTES);
        let mut end = self.range.start;
        for at in places.rev() {
            if place(flash, at).await != Place::Blank {
                end = at + RECORD_BYTES as u32;
                break;
            }
        }
        self.next = end;
        for at in (end..self.range.end).step_by(RECORD_BYTES).take(TRIES) {
            if steady(flash, at).await != Place::Blank {
                content.damaged += 1;
                self.next = at + RECORD_BYTES as u32;
            }
        }
        for at in (self.range.start..end).step_by(RECORD_BYTES).rev() {
            match steady(flash, at).await {
                Place::Blank => {}
                Place::Damaged => content.damaged += 1,
                Place::Record(record) => {
                    content.newest = Some(record);
                    break;
                }
            }
        }
        content
    }

    /// Writes `record` after the others and reads it back; false if the flash does not take it or the copy is full.
    pub async fn append<F: NorFlash>(&mut self, flash: &mut F, record: &Record) -> bool {
        let bytes = record.bytes();
        for _ in 0..TRIES {
            let at = self.next;
            if at >= self.range.end {
                return false;
            }
            self.next = at + RECORD_BYTES as u32;
            // A word that fails leaves a place that counts as damaged; the next one is tried.
            if flash.write(at, &bytes).await.is_ok()
                && steady(flash, at).await == Place::Record(*record)
            {
                return true;
            }
        }
        false
    }

    /// Returns true if there is room for a record.
    pub fn has_room(&self) -> bool {
        self.next + (TRIES * RECORD_BYTES) as u32 <= self.range.end
    }

    /// Erases the copy; false if the flash fails. It then counts as full, so that the next change erases it again.
    pub async fn erase<F: NorFlash>(&mut self, flash: &mut F) -> bool {
        let Range { start, end } = self.range;
        let is_erased = flash.erase(start, end).await.is_ok();
        self.next = if is_erased { start } else { end };
        is_erased
    }
}

/// The content of the place at `at`, damaged unless every one of [`READS`] finds the same.
async fn steady<F: NorFlash>(flash: &mut F, at: u32) -> Place {
    let first = place(flash, at).await;
    for _ in 1..READS {
        if first == Place::Damaged || place(flash, at).await != first {
            return Place::Damaged;
        }
    }
    first
}

/// The content of the place at `at`. A word that faults makes it damaged.
async fn place<F: NorFlash>(flash: &mut F, at: u32) -> Place {
    let mut bytes = [0; RECORD_BYTES];
    for (word, offset) in bytes
        .chunks_exact_mut(WORD_BYTES)
        .zip((at..).step_by(WORD_BYTES))
    {
        if flash.read(offset, word).await.is_err() {
            return Place::Damaged;
        }
    }
    Place::read(&bytes)
}
