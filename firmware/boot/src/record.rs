//! The record of updates: one word of the flash that is replaced as a whole.
//!
//! A change programs the next erased word of a sector; the record in force is the newest that can be read. A change
//! therefore happens completely or not at all, and a half-programmed record is skipped. When the words of a sector are
//! used up, the other sector is erased. It holds only older records, so a power loss during its erasure loses nothing.

use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage_async::nor_flash::NorFlash;

use crate::map::{ACTIVE, SECTOR_BYTES, WORD_BYTES};

/// Length of `embassy-boot`'s state, bytes: a mark, the validity of the progress, and the progress; then the checksum
/// of the image that an exchange puts aside, which `embassy-boot` does not use.
pub const MARKS: usize = 16;

/// Place of the progress in the marks.
const PROGRESS: usize = 2;

/// Place of the checksum in the marks.
const CHECK: usize = PROGRESS + 2 * EXCHANGED;

/// Number of steps of an exchange: two for each sector of the image. The way back has as many.
pub const EXCHANGED: usize = 2 * (ACTIVE.end - ACTIVE.start) as usize / SECTOR_BYTES;

const _: () = assert!(CHECK + 2 == MARKS);

/// Copies of `embassy-boot`'s marks, which it does not export. A test of `loader` checks that `embassy-boot` reads
/// these.
pub mod mark {
    /// The images are to be exchanged, or the new one is on trial.
    pub const SWAP: u8 = 0xF0;
    /// The active image is confirmed.
    pub const BOOT: u8 = 0xD0;
    /// The previous image has been put back.
    pub const REVERT: u8 = 0xC0;
    /// Nothing is written.
    pub const ERASED: u8 = 0xFF;
}

/// In place of a cause of a reset: an exchange was given up, because a sector could not be written.
pub const FLASH_FAILED: u8 = 0xFF;

/// Number of words of a sector that are used. An update with its way back takes about twenty.
const WORDS: u32 = 256;

/// Number of words that are tried for a record.
const TRIES: usize = 8;

/// Number of times that the newest words must read the same. A word that reads right half of the time passes once in a
/// million times.
const STEADY_READS: usize = 20;

pub(crate) const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Content of the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// State of `embassy-boot`.
    pub marks: [u8; MARKS],
    /// Index of the slot with which the active image is exchanged.
    pub slot: u8,
    /// Cause of the reset that ended a trial, or after which a committed update was not made: bits 28:21 of `RCC_RSR`,
    /// or [`FLASH_FAILED`]. Before that it is 0.
    pub cause: u8,
    /// Version of the image of the last update.
    pub version: [u16; 3],
}

impl Record {
    /// The record of a device that was never updated.
    pub const NONE: Self = Self::marked(mark::BOOT, 0, [0; 3]);

    /// A record with a mark and no progress.
    pub const fn marked(mark: u8, slot: u8, version: [u16; 3]) -> Self {
        let mut marks = [mark::ERASED; MARKS];
        marks[0] = mark;
        Self {
            marks,
            slot,
            cause: 0,
            version,
        }
    }

    /// Returns true if an exchange is asked for or under way, or the new image is on trial.
    pub fn asks(&self) -> bool {
        self.marks[0] == mark::SWAP
    }

    /// Number of steps done, those of an exchange and of the way back together.
    pub fn steps(&self) -> usize {
        let mut progress = self.marks[PROGRESS..CHECK].iter();
        let done = progress.position(|&step| step == mark::ERASED);
        match self.marks[PROGRESS - 1] {
            mark::ERASED => done.unwrap_or(2 * EXCHANGED),
            // The progress was made invalid: the way back is complete.
            _ => 2 * EXCHANGED,
        }
    }

    /// This record with at least `steps` steps done.
    #[must_use]
    pub fn with_steps(mut self, steps: usize) -> Self {
        self.marks[PROGRESS..][..steps].fill(0);
        self
    }

    /// Checksum of the image that an exchange puts aside; none before an exchange, or if the bootloader that wrote the
    /// record computed none.
    pub fn check(&self) -> Option<u16> {
        let check = u16::from_le_bytes([self.marks[CHECK], self.marks[CHECK + 1]]);
        (check != u16::MAX).then_some(check)
    }

    /// This record with `check`, below `u16::MAX`, as the checksum of the image that an exchange puts aside.
    #[must_use]
    pub fn with_check(mut self, check: u16) -> Self {
        self.marks[CHECK..].copy_from_slice(&check.to_le_bytes());
        self
    }

    fn word(&self, sequence: u32) -> [u8; WORD_BYTES] {
        let mut word = [0; WORD_BYTES];
        word[..4].copy_from_slice(&sequence.to_le_bytes());
        word[4..20].copy_from_slice(&self.marks);
        word[20] = self.slot;
        word[21] = self.cause;
        for (place, part) in word[22..28].as_chunks_mut::<2>().0.iter_mut().zip(self.version) {
            *place = part.to_le_bytes();
        }
        let crc = CRC.checksum(&word[..28]);
        word[28..].copy_from_slice(&crc.to_le_bytes());
        word
    }

    /// Number and record of a word; none if it is not whole.
    fn read(word: &[u8; WORD_BYTES]) -> Option<(u32, Self)> {
        let (fields, crc) = word.split_last_chunk::<4>()?;
        if CRC.checksum(fields) != u32::from_le_bytes(*crc) {
            return None;
        }
        let (sequence, rest) = fields.split_first_chunk::<4>()?;
        let (marks, rest) = rest.split_first_chunk::<MARKS>()?;
        let mut versions = rest[2..].as_chunks::<2>().0.iter();
        let record = Self {
            marks: *marks,
            slot: rest[0],
            cause: rest[1],
            version: core::array::from_fn(|_| versions.next().map_or(0, |part| u16::from_le_bytes(*part))),
        };
        Some((u32::from_le_bytes(*sequence), record))
    }
}

/// The record in its two sectors.
#[derive(Clone, Debug)]
pub struct Store<F> {
    flash: F,
    /// Range of the two sectors in the flash.
    range: Range<u32>,
    record: Record,
    /// Number of the record in force, or the highest number that an unreadable word after it may have.
    sequence: u32,
    /// Offset of the sector in use.
    start: u32,
    /// Offset of the next word to be programmed.
    next: u32,
    /// True if each start will find the same. Otherwise the newest word may have been cut at its very end. It may then
    /// read right many times and wrong once, so that the record before it counts.
    is_settled: bool,
    /// True once this run has written a record, whose word is certainly whole.
    is_renewed: bool,
}

/// Failure to keep a record: it could not be read back from any word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotKept;

/// Content of a word that is not erased.
type Used = Option<[u8; WORD_BYTES]>;

impl<F: NorFlash> Store<F> {
    /// Reads the record from the two sectors of `flash` at `range`. If no record can be read, nothing is under way.
    pub async fn open(flash: F, range: Range<u32>) -> Self {
        let mut store = Self {
            flash,
            start: range.start,
            next: range.start,
            range,
            record: Record::NONE,
            sequence: 0,
            is_settled: true,
            is_renewed: false,
        };
        let mut newest: Option<(u32, Record, u32)> = None;
        let mut before: Option<(u32, Record)> = None;
        for sector in store.range.clone().step_by(SECTOR_BYTES) {
            let mut end = sector;
            for at in (sector..).step_by(WORD_BYTES).take(WORDS as usize) {
                let Some(used) = store.used_word(at).await else {
                    continue;
                };
                end = at + WORD_BYTES as u32;
                let read = used.as_ref().and_then(Record::read);
                let Some((sequence, record)) = read else {
                    continue;
                };
                if newest.is_none_or(|(newest, ..)| is_newer(sequence, newest)) {
                    let newest = newest.replace((sequence, record, at));
                    before = newest.map(|(sequence, record, _)| (sequence, record));
                } else if before.is_none_or(|(before, _)| is_newer(sequence, before)) {
                    before = Some((sequence, record));
                }
            }
            let is_newest = newest.is_some_and(|(_, _, at)| at >= sector);
            if is_newest || sector == store.range.start {
                (store.start, store.next) = (sector, end);
            }
        }
        // A word whose programming was cut may have read as erased above.
        while !store.reads_steadily(store.due()..store.due() + WORD_BYTES as u32).await {
            store.is_settled = false;
            if store.due() != store.next {
                break;
            }
            store.next += WORD_BYTES as u32;
        }
        let (sequence, record, at) = newest.unwrap_or((1, Record::NONE, store.start));
        let used = (store.next - at) / WORD_BYTES as u32;
        (store.sequence, store.record) = (sequence.wrapping_add(used).wrapping_sub(1), record);
        let asked_before = before.is_some_and(|(_, record)| record.asks());
        store.is_settled &= asked_before == record.asks();
        store.is_settled &= store.reads_steadily(at..store.next).await;
        store
    }

    /// Offset of the word that the next change programs. If the word is in the other sector, that sector is erased
    /// first.
    const fn due(&self) -> u32 {
        if self.next < self.start + WORDS * WORD_BYTES as u32 {
            self.next
        } else if self.start == self.range.start {
            self.start + SECTOR_BYTES as u32
        } else {
            self.range.start
        }
    }

    /// Returns nothing if the word at `at` is erased, and otherwise its content, which is none if it cannot be read.
    async fn used_word(&mut self, at: u32) -> Option<Used> {
        let mut word = [0; WORD_BYTES];
        let read = self.flash.read(at, &mut word).await.ok().map(|()| word);
        (read != Some([mark::ERASED; WORD_BYTES])).then_some(read)
    }

    /// Returns true if every word of `range` reads the same each time.
    async fn reads_steadily(&mut self, range: Range<u32>) -> bool {
        for at in range.step_by(WORD_BYTES) {
            let first = self.used_word(at).await;
            for _ in 0..STEADY_READS {
                if self.used_word(at).await != first {
                    return false;
                }
            }
        }
        true
    }

    /// The record in force.
    pub const fn record(&self) -> Record {
        self.record
    }

    /// Writes the record again if a later start could read a different one: a word does not read the same each time, or
    /// this record and the previous one disagree on whether to exchange images. Also writes it again if a
    /// [`Store::renew`] of this run could lack room. Called at the start, because an erasure may take seconds.
    pub async fn settle(&mut self) -> Result<(), NotKept> {
        if self.is_settled && self.has_room() {
            return Ok(());
        }
        self.replace(self.record).await
    }

    /// Writes the record again unless this run has written one. Called before something is given up that an older
    /// record would need, because no number of reads proves that a word is whole. Never erases, because something may
    /// be played.
    pub async fn renew(&mut self) -> Result<(), NotKept> {
        if self.is_renewed {
            return Ok(());
        }
        if !self.has_room() {
            return Err(NotKept);
        }
        self.replace(self.record).await
    }

    /// Returns true if [`Store::replace`] certainly erases nothing.
    const fn has_room(&self) -> bool {
        self.next + (TRIES * WORD_BYTES) as u32 <= self.start + WORDS * WORD_BYTES as u32
    }

    /// Replaces the record.
    ///
    /// # Errors
    /// The flash does not keep it. The previous record is in force then.
    pub async fn replace(&mut self, record: Record) -> Result<(), NotKept> {
        let sequence = self.sequence.wrapping_add(1);
        let word = record.word(sequence);
        for _ in 0..TRIES {
            // The word counts as used even if it fails, because it cannot be programmed again without an erasure.
            let at = self.free_word().await?;
            let written = self.flash.write(at, &word).await.is_ok();
            if written && self.used_word(at).await == Some(Some(word)) {
                (self.sequence, self.record) = (sequence, record);
                (self.is_settled, self.is_renewed) = (true, true);
                return Ok(());
            }
        }
        // A word that failed may still read right at a later start, so the next record must have a higher number.
        self.sequence = sequence;
        (self.is_settled, self.is_renewed) = (false, false);
        Err(NotKept)
    }

    /// Returns the offset of an erased word, and counts the word as used.
    async fn free_word(&mut self) -> Result<u32, NotKept> {
        let at = self.due();
        if at != self.next {
            let end = at + SECTOR_BYTES as u32;
            self.flash.erase(at, end).await.map_err(|_| NotKept)?;
            (self.start, self.next) = (at, at);
        }
        self.next += WORD_BYTES as u32;
        Ok(at)
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }
}

/// Returns true if record or upload number `one` came after number `other`. Numbers wrap.
pub const fn is_newer(one: u32, other: u32) -> bool {
    (one.wrapping_sub(other) as i32) > 0
}
