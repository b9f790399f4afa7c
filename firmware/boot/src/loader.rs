//! The exchange of images by `embassy-boot`, on any flash: the microcontroller's, or one in memory with which tests
//! simulate losses of power.
//!
//! Only images are moved. Before the first step of an exchange, the slot must begin with an image. Before the first
//! step back, the slot must hold the image that was put aside, as its checksum shows. Otherwise the record is misread,
//! and the slot has been given to a library meanwhile; the active image then stays.
//!
//! A step whose sector cannot be erased or written is tried [`TRIES`] times. Then the exchange is given up, and the
//! sectors that were exchanged are restored from the slot by the last steps of the way back. The way back itself leaves
//! out what only keeps the new image. Only a sector of the active part that is worn cannot be avoided: there the start
//! ends until the sector can be written.

use core::cell::RefCell;
use core::ops::Range;

use embassy_boot::{BootError, BootLoader, BootLoaderConfig};
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_futures::block_on;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use crate::map::{ACTIVE, FLASH, RECORDS, SECTOR_BYTES, SLOTS, WORD_BYTES};
use crate::record::{CRC, EXCHANGED, FLASH_FAILED, MARKS, NotKept, Record, Store, mark};

/// Bytes that are copied at once.
const COPIED_BYTES: usize = 4096;

/// Number of times that a step is tried in one start.
const TRIES: usize = 3;

/// Finds the image to run, and exchanges images if an update asks for it. Offsets in `flash` count from its start.
///
/// `begin` is called before anything is erased or programmed. The record keeps `cause`, the cause of this reset, if the
/// reset ends a trial, or if a committed update is not made. Later resets, on the way back, do not replace it.
///
/// # Errors
/// The flash fails at a step that must be done. The exchange continues at the next start.
pub fn prepare<F: NorFlash>(flash: F, cause: u8, mut begin: impl FnMut()) -> Result<(), BootError> {
    let flash = RefCell::new(flash);
    // Each try continues where the one before failed.
    while (0..TRIES).all(|_| exchange(&flash, cause, &mut begin).is_err()) {
        let mut store = records(&flash);
        let record = store.record();
        let kept = without_next_step(record, &flash).map(|record| block_on(store.replace(record)));
        if !matches!(kept, Some(Ok(()))) {
            // Before the first step and after the last one the active image is whole, whatever the record says.
            let is_whole = record.steps().is_multiple_of(2 * EXCHANGED);
            return is_whole.then_some(()).ok_or(BootError::Flash(NorFlashErrorKind::Other));
        }
    }
    Ok(())
}

/// The record in `flash`.
fn records<F: NorFlash>(flash: &RefCell<F>) -> Store<BlockingAsync<Part<'_, F>>> {
    let part = Part::new(flash, 0..SLOTS[1].end, false);
    block_on(Store::open(BlockingAsync::new(part), RECORDS))
}

/// Returns the record with which the step after `record`, which fails, need not be done; none if it must be.
fn without_next_step<F: NorFlash>(mut record: Record, flash: &RefCell<F>) -> Option<Record> {
    const ALL: usize = 2 * EXCHANGED;
    let done = record.steps();
    let mut steps = match done {
        // Each two steps have put a sector aside and replaced it, the last sector first. The way back restores them in
        // the opposite order. Its steps before these count as done, and a step that was begun is undone, too.
        0..EXCHANGED => ALL.min(ALL + 1 - done.next_multiple_of(2)),
        // The step only puts a sector of the new image aside.
        EXCHANGED..ALL => done / 2 * 2 + 1,
        _ => return None,
    };
    // A sector that cannot be erased may hold already what the step would copy.
    let slot = SLOTS.get(usize::from(record.slot))?;
    if steps % 2 == 1 && is_restored(flash, slot.start, (steps - EXCHANGED) / 2) {
        steps += 1;
    }
    if done < EXCHANGED {
        record.cause = FLASH_FAILED;
    }
    (steps > done).then(|| record.with_steps(steps))
}

/// Returns true if `sector` of the active image is as an exchange has put it aside in the slot at `slot`.
fn is_restored<F: NorFlash>(flash: &RefCell<F>, slot: u32, sector: usize) -> bool {
    let from = (sector * SECTOR_BYTES) as u32;
    let mut flash = flash.borrow_mut();
    let mut word = |at| {
        let mut word = [0; WORD_BYTES];
        flash.read(at, &mut word).ok().map(|()| word)
    };
    let mut offsets = (from..).step_by(WORD_BYTES).take(SECTOR_BYTES / WORD_BYTES);
    offsets.all(|at| {
        let active = word(ACTIVE.start + at);
        active.is_some() && active == word(slot + SECTOR_BYTES as u32 + at)
    })
}

/// Does what the record asks for, from the first step that is not done.
fn exchange<F: NorFlash>(flash: &RefCell<F>, cause: u8, begin: &mut impl FnMut()) -> Result<(), BootError> {
    let mut store = records(flash);
    let record = store.record();
    let Some(slot) = SLOTS.get(usize::from(record.slot)) else {
        return Ok(());
    };
    if !record.asks() {
        return Ok(());
    }
    begin();
    let [mut active, mut dfu] = [ACTIVE, slot.clone()].map(|range| Part::new(flash, range, true));
    let judged = judged(record, &mut active, &mut dfu)?;
    let goes_on = judged.asks() && record.steps() < EXCHANGED;
    let cause = if goes_on || record.cause != 0 {
        record.cause
    } else {
        cause
    };
    // Power may have been lost just before the record's word was complete, so that it reads right this time only. Now
    // it is programmed again, as a whole.
    block_on(store.replace(Record { cause, ..judged }))?;
    if !judged.asks() {
        return Ok(());
    }
    let state = Marks(store);
    let mut loader = BootLoader::new(BootLoaderConfig { active, dfu, state });
    loader.prepare_boot(&mut [0; COPIED_BYTES]).map(drop)
}

/// Returns the record to continue with: `record`, with a checksum before the first step, or a record that asks for
/// nothing if the slot does not hold the image.
fn judged<F: NorFlash>(
    record: Record,
    active: &mut Part<'_, F>,
    slot: &mut Part<'_, F>,
) -> Result<Record, NorFlashErrorKind> {
    // An exchange leaves the previous image one sector further on in the slot.
    let aside = SECTOR_BYTES as u32;
    let without = |mark| Record::marked(mark, record.slot, record.version);
    Ok(match (record.steps(), record.check()) {
        (0, None) if is_image(slot, 0)? => record.with_check(check(active, 0)?),
        // The update was committed and is not made, so it is reported as taken back.
        (0, None) => without(mark::REVERT),
        // There is nothing to go back to, so the new image is kept as if it were confirmed.
        (EXCHANGED, Some(kept)) if check(slot, aside)? != kept => without(mark::BOOT),
        (EXCHANGED, None) if !is_image(slot, aside)? => without(mark::BOOT),
        // After a power loss in the first step of either way, the step is done again. It changes nothing that was
        // checked.
        _ => record,
    })
}

/// Returns true if an image is at `offset`: a table of vectors with a stack in RAM and a reset handler in the image.
fn is_image<F: NorFlash>(part: &mut Part<'_, F>, offset: u32) -> Result<bool, NorFlashErrorKind> {
    let mut word = [0; WORD_BYTES];
    part.read(offset, &mut word)?;
    let [stack, reset, ..] = *word.as_chunks::<4>().0 else {
        return Ok(false);
    };
    let handler = u32::from_le_bytes(reset).wrapping_sub(FLASH);
    Ok(
        (0x2000_0000..0x4000_0000).contains(&u32::from_le_bytes(stack))
            && handler % 2 == 1
            && ACTIVE.contains(&handler),
    )
}

/// Checksum of as many bytes as an image may have, from `offset` on.
fn check<F: NorFlash>(part: &mut Part<'_, F>, offset: u32) -> Result<u16, NorFlashErrorKind> {
    let mut digest = CRC.digest();
    let mut word = [0; WORD_BYTES];
    for at in (offset..).step_by(WORD_BYTES).take(ACTIVE.len() / WORD_BYTES) {
        part.read(at, &mut word)?;
        digest.update(&word);
    }
    // All ones in the record mean that there is no checksum.
    Ok((digest.finalize() as u16).min(u16::MAX - 1))
}

/// A part of the flash.
struct Part<'f, F> {
    flash: &'f RefCell<F>,
    range: Range<u32>,
    /// True if an unreadable word is read as erased. Such a word lies behind the image, whose own words have been read
    /// back.
    is_image: bool,
}

impl<'f, F: NorFlash> Part<'f, F> {
    const fn new(flash: &'f RefCell<F>, range: Range<u32>, is_image: bool) -> Self {
        Self { flash, range, is_image }
    }
}

impl<F: NorFlash> ErrorType for Part<'_, F> {
    type Error = NorFlashErrorKind;
}

impl<F: NorFlash> ReadNorFlash for Part<'_, F> {
    const READ_SIZE: usize = WORD_BYTES;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = (self.range.start + offset..).step_by(WORD_BYTES);
        for (at, word) in at.zip(bytes.chunks_mut(WORD_BYTES)) {
            match self.flash.borrow_mut().read(at, word) {
                Err(_) if self.is_image => word.fill(mark::ERASED),
                read => read.map_err(|error| error.kind())?,
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl<F: NorFlash> NorFlash for Part<'_, F> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let start = self.range.start;
        let erased = self.flash.borrow_mut().erase(start + from, start + to);
        erased.map_err(|error| error.kind())
    }

    /// Writes whole words and reads them back, because a worn word may take its bits without an error.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let at = self.range.start + offset;
        let mut flash = self.flash.borrow_mut();
        flash.write(at, bytes).map_err(|error| error.kind())?;
        for (at, written) in (at..).step_by(WORD_BYTES).zip(bytes.chunks(WORD_BYTES)) {
            let mut word = [0; WORD_BYTES];
            flash.read(at, &mut word).map_err(|error| error.kind())?;
            if word != written {
                return Err(NorFlashErrorKind::Other);
            }
        }
        Ok(())
    }
}

/// The marks of the record as a flash of 16 bytes, for `embassy-boot`: each of its operations replaces the record.
struct Marks<F>(Store<F>);

impl NorFlashError for NotKept {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<F> ErrorType for Marks<F> {
    type Error = NotKept;
}

impl<F: embedded_storage_async::nor_flash::NorFlash> ReadNorFlash for Marks<F> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NotKept> {
        let marks = self.0.record().marks;
        let from = offset as usize;
        let read = marks.get(from..from + bytes.len()).ok_or(NotKept)?;
        bytes.copy_from_slice(read);
        Ok(())
    }

    fn capacity(&self) -> usize {
        MARKS
    }
}

impl<F: embedded_storage_async::nor_flash::NorFlash> NorFlash for Marks<F> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = MARKS;

    fn erase(&mut self, _: u32, _: u32) -> Result<(), NotKept> {
        let mut record = self.0.record();
        record.marks = [mark::ERASED; MARKS];
        block_on(self.0.replace(record))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NotKept> {
        let mut record = self.0.record();
        let from = offset as usize;
        let place = record.marks.get_mut(from..from + bytes.len());
        place.ok_or(NotKept)?.copy_from_slice(bytes);
        block_on(self.0.replace(record))
    }
}

#[cfg(test)]
mod tests {
    use embassy_boot::State;

    use super::*;

    #[test]
    fn embassy_boot_reads_the_marks_as_they_are_meant() {
        assert_eq!(State::from([mark::SWAP]), State::Swap);
        assert_eq!(State::from([mark::REVERT]), State::Revert);
        for other in [mark::BOOT, mark::ERASED] {
            assert_eq!(State::from([other]), State::Boot);
        }
    }
}
