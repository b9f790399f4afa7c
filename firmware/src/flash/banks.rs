//! Drivers of the flash banks for the NorFlash traits: the library slots of bank 2, and the sectors of bank 1 that hold
//! the settings and the record of updates.
//!
//! embassy-stm32's own driver waits for an erasure, a second or two, without yielding, and turns an uncorrectable word
//! into a hard fault. This driver follows RM0433 section 4.3. Every wait is bounded. A read after a write comes from
//! the flash array itself, because neither the slots nor the sectors of bank 1 used here are cached
//! (`boot/protection.rs`).
//!
//! - **Bank 2** is erased and written while everything else runs: code runs from bank 1, the tick from ITCM.
//! - **Bank 1** holds the code, whose fetches stall while the bank is busy. The wait for the bank runs from ITCM. It
//!   hides the code from the processor, which would otherwise fetch ahead, and masks the interrupts of tasks, whose
//!   handlers lie in flash. Tick and update continue. Settings must therefore be written only while nothing else
//!   matters: a word takes a tenth of a millisecond, a change has 32 of them, and one in some 250 changes needs two
//!   erasures. While something is played, only the record of updates is renewed, without an erasure. embassy's clock
//!   counts half turns of 32.8 ms by an interrupt that is masked during that wait. So an erasure makes the clock late
//!   by whole turns, and every running timeout longer. The clock never steps back. The device's time is the tick's
//!   count, which continues.
#![expect(
    unsafe_code,
    reason = "the flash's registers change memory, and the memory is read in place"
)]

use core::ops::Range;
use core::slice;

use cortex_m::peripheral::{DWT, NVIC};
use cortex_m::register::basepri;
use embassy_futures::yield_now;
use embassy_stm32::pac::flash::regs::Sr;
use embassy_time::{Duration, Instant, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use model_format::limits::SLOT_BYTES;
use stylus_app::flash::{BANK_BYTES, SECTOR_BYTES, WORD_BYTES};
use stylus_app::slots::MappedFlash;
use stylus_boot::registers::{BANK_1, BANK_2, Bank, words};
use stylus_boot::supply;

use crate::boot::clock::CORE_HZ;
use crate::boot::{priority, protection};
use crate::fault::watchdog;
use crate::flash::errors::{self, read_word};

/// Longest erasure of a sector: twice the maximum of DS12110 (table 60, parallelism of 8 bits).
const ERASE_LIMIT: Duration = Duration::from_secs(8);

/// Longest programming of a flash word: many times the maximum of DS12110.
const PROGRAM_LIMIT: Duration = Duration::from_millis(10);

/// Words of a sector that are checked between two turns of other tasks, some 30 µs.
const WORDS_PER_TURN: usize = 64;

/// Failure of a flash operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum FlashError {
    /// A range outside this part of the flash, or one that is not a number of whole words or sectors.
    Range(OutOfRange),
    /// A word that cannot be read, because its error-correcting code found two errors.
    Unreadable {
        /// Address of the word.
        address: u32,
    },
    /// A fault that the flash reports, or an erasure that it did not carry out.
    Refused {
        /// Value of FLASH_SR.
        status: u32,
    },
    /// The flash stays busy for longer than it should.
    Timeout,
    /// The supply is too low to erase or program.
    SupplyLow,
}

/// Reason why a range is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum OutOfRange {
    /// Not a number of whole words or sectors.
    NotAligned,
    /// Outside this part of the flash.
    OutOfBounds,
}

impl core::fmt::Display for FlashError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Range(_) => write!(
                f,
                "the range lies outside this part of the flash or is not of whole words or sectors"
            ),
            Self::Unreadable { address } => {
                write!(f, "the flash word at {address:#010x} cannot be read: erase its sector")
            }
            Self::Refused { status } => write!(f, "the flash reports {status:#010x} (RM0433, FLASH_SR): try again"),
            Self::Timeout => write!(f, "the flash does not become ready: restart the device"),
            Self::SupplyLow => write!(f, "the supply is too low to write flash: see to it"),
        }
    }
}

impl core::error::Error for FlashError {}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Range(OutOfRange::NotAligned) => NorFlashErrorKind::NotAligned,
            Self::Range(OutOfRange::OutOfBounds) => NorFlashErrorKind::OutOfBounds,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// Checks that `length` bytes from `offset` lie in `within`, in whole units of `unit` bytes.
fn check(offset: u32, length: usize, unit: usize, within: Range<u32>) -> Result<(), FlashError> {
    if !(offset as usize).is_multiple_of(unit) || !length.is_multiple_of(unit) {
        return Err(FlashError::Range(OutOfRange::NotAligned));
    }
    let end = u64::from(offset) + length as u64;
    if offset < within.start || end > u64::from(within.end) {
        return Err(FlashError::Range(OutOfRange::OutOfBounds));
    }
    Ok(())
}

/// Length of the range from `from` to `to`, bytes.
fn length(from: u32, to: u32) -> Result<usize, FlashError> {
    to.checked_sub(from)
        .map(|length| length as usize)
        .ok_or(FlashError::Range(OutOfRange::OutOfBounds))
}

/// Reads bytes of words that may be unreadable.
fn read(bank: Bank, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
    let mut at = bank.address + offset;
    let mut rest = bytes;
    while !rest.is_empty() {
        let within = at as usize % WORD_BYTES;
        let word = at - within as u32;
        let read = read_word(word).ok_or(FlashError::Unreadable { address: word })?;
        let length = rest.len().min(WORD_BYTES - within);
        let (now, later) = rest.split_at_mut(length);
        now.copy_from_slice(&read[within..within + length]);
        at += length as u32;
        rest = later;
    }
    Ok(())
}

/// Prepares an erasure or the programming of a word: checks that the supply holds and the bank is idle, clears old
/// faults, and unlocks the bank.
fn prepare(bank: Bank) -> Result<(), FlashError> {
    if supply::is_low() {
        return Err(FlashError::SupplyLow);
    }
    if bank.is_busy() {
        return Err(FlashError::Timeout);
    }
    // Counted first, because `unlock` clears the flags.
    errors::take(bank.index);
    bank.unlock();
    Ok(())
}

/// Locks the bank and returns the status with which the operation has ended.
fn end(bank: Bank) -> Result<Sr, FlashError> {
    errors::take(bank.index);
    bank.end().map_err(|status| FlashError::Refused { status: status.0 })
}

/// Checks that the sector at `offset` is erased, because a command that a bank ignores ends like one that the bank has
/// carried out. `status` is the status with which the erasure ended.
async fn check_erased(bank: Bank, offset: u32, status: Sr) -> Result<(), FlashError> {
    for at in (offset..).step_by(WORD_BYTES).take(SECTOR_BYTES / WORD_BYTES) {
        if read_word(bank.address + at) != Some([0xFF; WORD_BYTES]) {
            return Err(FlashError::Refused { status: status.0 });
        }
        if (at as usize).is_multiple_of(WORDS_PER_TURN * WORD_BYTES) {
            yield_now().await;
        }
    }
    Ok(())
}

/// Bank 2: slot A and slot B.
pub struct Bank2(());

impl Bank2 {
    const RANGE: Range<u32> = 0..2 * SLOT_BYTES as u32;

    /// The only value of this type.
    ///
    /// # Safety
    /// Called once.
    pub const unsafe fn new() -> Self {
        Self(())
    }

    async fn wait(limit: Duration, pause: Option<Duration>) -> Result<(), FlashError> {
        let begin = Instant::now();
        while BANK_2.is_busy() {
            // Saturating, because the time driver may be late by half a period.
            if Instant::now().saturating_duration_since(begin) > limit {
                return Err(FlashError::Timeout);
            }
            match pause {
                Some(pause) => Timer::after(pause).await,
                None => yield_now().await,
            }
        }
        Ok(())
    }
}

impl ErrorType for Bank2 {
    type Error = FlashError;
}

impl ReadNorFlash for Bank2 {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), Self::READ_SIZE, Self::RANGE)?;
        read(BANK_2, offset, bytes)
    }

    fn capacity(&self) -> usize {
        2 * SLOT_BYTES
    }
}

impl NorFlash for Bank2 {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check(from, length(from, to)?, Self::ERASE_SIZE, Self::RANGE)?;
        for sector in (from..to).step_by(Self::ERASE_SIZE) {
            // If the caller of an earlier erasure gave up waiting, that erasure ends first.
            Self::wait(ERASE_LIMIT, Some(Duration::from_millis(1))).await?;
            prepare(BANK_2)?;
            BANK_2.begin_erase(sector);
            let waited = Self::wait(ERASE_LIMIT, Some(Duration::from_millis(1))).await;
            let status = end(BANK_2)?;
            waited?;
            check_erased(BANK_2, sector, status).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), Self::WRITE_SIZE, Self::RANGE)?;
        for (at, word) in (offset..).step_by(WORD_BYTES).zip(words(bytes)) {
            Self::wait(ERASE_LIMIT, None).await?;
            prepare(BANK_2)?;
            BANK_2.begin_program(at, &word);
            let waited = Self::wait(PROGRAM_LIMIT, None).await;
            end(BANK_2)?;
            waited?;
        }
        Ok(())
    }
}

impl MappedFlash for Bank2 {
    fn bytes(&self, range: Range<u32>) -> Result<&[u8], FlashError> {
        check(range.start, length(range.start, range.end)?, 1, Self::RANGE)?;
        let start = (BANK_2.address + range.start) as *const u8;
        // SAFETY: this is flash for as long as the processor runs, and it changes only by methods that borrow this
        // value exclusively. A read does not fault, because by the contract of the trait the caller has read every word
        // before.
        Ok(unsafe { slice::from_raw_parts(start, range.len()) })
    }
}

/// Sectors of bank 1: those of the settings, or those of the record of updates. Offsets count from the start of the
/// bank.
pub struct Bank1(Range<u32>);

impl Bank1 {
    /// The sectors of `range`.
    ///
    /// # Safety
    /// Called once per sector, and no code lies in these sectors.
    pub const unsafe fn new(range: Range<u32>) -> Self {
        Self(range)
    }
}

impl ErrorType for Bank1 {
    type Error = FlashError;
}

impl ReadNorFlash for Bank1 {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), Self::READ_SIZE, self.0.clone())?;
        read(BANK_1, offset, bytes)
    }

    fn capacity(&self) -> usize {
        BANK_BYTES
    }
}

impl NorFlash for Bank1 {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check(from, length(from, to)?, Self::ERASE_SIZE, self.0.clone())?;
        for sector in (from..to).step_by(Self::ERASE_SIZE) {
            prepare(BANK_1)?;
            let done = erase_without_code(sector);
            let status = end(BANK_1)?;
            in_time(done)?;
            check_erased(BANK_1, sector, status).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), Self::WRITE_SIZE, self.0.clone())?;
        for (at, word) in (offset..).step_by(WORD_BYTES).zip(words(bytes)) {
            prepare(BANK_1)?;
            let done = program_without_code(at, &word);
            end(BANK_1)?;
            in_time(done)?;
            yield_now().await;
        }
        Ok(())
    }
}

/// Returns success if an operation was `done` within its limit, and a timeout otherwise.
fn in_time(done: bool) -> Result<(), FlashError> {
    if done { Ok(()) } else { Err(FlashError::Timeout) }
}

/// Erases the sector of bank 1 at `offset` and waits for the end, in ITCM. Returns false if that takes too long. The
/// build's check of placement knows this function's name.
#[inline(never)]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.flash_erase")]
extern "C" fn erase_without_code(offset: u32) -> bool {
    let mask = mask_tasks();
    protection::hide_code();
    BANK_1.begin_erase(offset);
    let done = wait_without_code(const { ERASE_LIMIT.as_millis() as u32 });
    protection::show_code();
    unmask(mask);
    done
}

/// Programs a word of bank 1 at `offset` and waits for the end, in ITCM. Returns false if that takes too long. The
/// build's check of placement knows this function's name.
#[inline(never)]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.flash_program")]
extern "C" fn program_without_code(offset: u32, word: &[u32; WORD_BYTES / 4]) -> bool {
    let mask = mask_tasks();
    protection::hide_code();
    BANK_1.begin_program(offset, word);
    let done = wait_without_code(const { PROGRAM_LIMIT.as_millis() as u32 });
    protection::show_code();
    unmask(mask);
    done
}

/// Waits for bank 1, at most `limit_ms` by the cycle counter, because embassy's clock runs from flash. Feeds the
/// watchdog as long as the tick advances. Returns false if the bank is still busy.
#[inline(always)]
fn wait_without_code(limit_ms: u32) -> bool {
    for _ in 0..limit_ms {
        let begin = DWT::cycle_count();
        while DWT::cycle_count().wrapping_sub(begin) < CORE_HZ / 1000 {
            if !BANK_1.is_busy() {
                return true;
            }
        }
        watchdog::feed_while_ticking();
    }
    false
}

/// State of the masks before [`mask_tasks`].
#[derive(Clone, Copy)]
struct Masked {
    priorities: u8,
    serial: bool,
}

/// Masks the interrupts whose handlers lie in flash.
#[inline(always)]
fn mask_tasks() -> Masked {
    let before = Masked {
        priorities: basepri::read(),
        serial: !NVIC::is_enabled(priority::SERIAL),
    };
    // BASEPRI cannot mask it without the update, which is less urgent and must continue.
    NVIC::mask(priority::SERIAL);
    // SAFETY: no critical section of this program masks by priority; tick and update are more urgent than the mask.
    unsafe { basepri::write(priority::TASKS_MASK) };
    before
}

#[inline(always)]
fn unmask(before: Masked) {
    // SAFETY: both masks return to their state before `mask_tasks`.
    unsafe {
        basepri::write(before.priorities);
        if !before.serial {
            NVIC::unmask(priority::SERIAL);
        }
    }
}
