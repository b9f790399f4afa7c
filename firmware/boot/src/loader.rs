//! The exchange of images by `embassy-boot`, on any flash: the microcontroller's, or one in memory with which tests
//! simulate losses of power.
//!
//! Only images are moved. Before the first step of an exchange, the slot must begin with an image. Before the first
//! step back, the slot must hold the image that was put aside, as its checksum shows. Otherwise the record is misread,
//! and the slot has been given to a library meanwhile; the active image then stays. Once a step has been done, the
//! exchange must be completed.

use core::cell::RefCell;
use core::ops::Range;

use embassy_boot::{BootError, BootLoader, BootLoaderConfig};
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_futures::block_on;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use crate::map::{ACTIVE, FLASH, RECORDS, SECTOR_BYTES, SLOTS, WORD_BYTES};
use crate::record::{CRC, EXCHANGED, MARKS, NotKept, Record, Store, mark};

/// Bytes that are copied at once.
const COPIED_BYTES: usize = 4096;

/// Finds the image to run, and exchanges images if an update asks for it. Offsets in `flash` count from its start.
///
/// `begin` is called before anything is erased or programmed. The record keeps `cause`, the cause of this reset, if the
/// reset ends a trial, or if a committed update is not made. Later resets, on the way back, do not replace it.
///
/// # Errors
/// The flash fails. The exchange continues at the next start.
pub fn prepare<F: NorFlash>(flash: F, cause: u8, begin: impl FnOnce()) -> Result<(), BootError> {
    let flash = RefCell::new(flash);
    let part = |range: Range<u32>, is_image: bool| Part {
        flash: &flash,
        range,
        is_image,
    };
    let records = BlockingAsync::new(part(0..SLOTS[1].end, false));
    let mut store = block_on(Store::open(records, RECORDS));
    let record = store.record();
    let Some(slot) = SLOTS.get(usize::from(record.slot)) else {
        return Ok(());
    };
    if !record.asks() {
        return Ok(());
    }
    begin();
    let (mut active, mut dfu) = (part(ACTIVE, true), part(slot.clone(), true));
    let judged = judged(record, &mut active, &mut dfu).map_err(|error| other(&error))?;
    let goes_on = judged.asks() && record.steps() < EXCHANGED;
    let cause = if goes_on || record.cause != 0 {
        record.cause
    } else {
        cause
    };
    // Power may have been lost just before the record's word was complete, so that it reads right this time only. Now
    // it is programmed again, as a whole.
    let kept = block_on(store.replace(Record { cause, ..judged }));
    kept.map_err(|error| other(&error))?;
    if !judged.asks() {
        return Ok(());
    }
    let state = Marks(store);
    let mut loader = BootLoader::new(BootLoaderConfig { active, dfu, state });
    loader.prepare_boot(&mut [0; COPIED_BYTES]).map(drop)
}

fn other(error: &impl NorFlashError) -> BootError {
    BootError::Flash(error.kind())
}

/// Returns the record to continue with: `record`, with a checksum before the first step, or a record that asks for
/// nothing if the slot does not hold the image.
fn judged<F: NorFlash>(record: Record, active: &mut Part<'_, F>, slot: &mut Part<'_, F>) -> Result<Record, F::Error> {
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
fn is_image<F: NorFlash>(part: &mut Part<'_, F>, offset: u32) -> Result<bool, F::Error> {
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
fn check<F: NorFlash>(part: &mut Part<'_, F>, offset: u32) -> Result<u16, F::Error> {
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

impl<F: NorFlash> ErrorType for Part<'_, F> {
    type Error = F::Error;
}

impl<F: NorFlash> ReadNorFlash for Part<'_, F> {
    const READ_SIZE: usize = WORD_BYTES;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        let at = (self.range.start + offset..).step_by(WORD_BYTES);
        for (at, word) in at.zip(bytes.chunks_mut(WORD_BYTES)) {
            match self.flash.borrow_mut().read(at, word) {
                Err(_) if self.is_image => word.fill(mark::ERASED),
                read => read?,
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

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let start = self.range.start;
        self.flash.borrow_mut().erase(start + from, start + to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        let at = self.range.start + offset;
        self.flash.borrow_mut().write(at, bytes)
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
