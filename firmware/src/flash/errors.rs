//! Reads of a flash word that may be unreadable, and the count of errors that the flash's error-correcting code has
//! corrected or found (RM0433 section 4.3.12).
//!
//! The flags in FLASH_SR show only that there was an error. They are counted here before anything clears them, so
//! several errors between two looks count as one.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac::FLASH;
use stylus_app::flash::WORD_BYTES;

/// Counters of one bank.
struct Counters {
    corrected: AtomicU32,
    failed: AtomicU32,
}

static COUNTERS: [Counters; 2] = [const {
    Counters {
        corrected: AtomicU32::new(0),
        failed: AtomicU32::new(0),
    }
}; 2];

/// Numbers of errors of one bank since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Errors {
    /// Corrected errors.
    pub corrected: u32,
    /// Errors that could not be corrected.
    pub failed: u32,
}

/// Counts the errors of `bank`, 0 or 1, that its flags show, and clears these flags.
pub fn take(bank: usize) {
    let status = FLASH.bank(bank).sr().read();
    let (corrected, failed) = (status.sneccerr1(), status.dbeccerr());
    if corrected || failed {
        FLASH.bank(bank).ccr().write(|w| {
            w.set_clr_sneccerr(corrected);
            w.set_clr_dbeccerr(failed);
        });
    }
    let counters = &COUNTERS[bank];
    for (counter, seen) in [(&counters.corrected, corrected), (&counters.failed, failed)] {
        // Only tasks count, so load and store need not be one access.
        let count = counter.load(Ordering::Relaxed);
        counter.store(count.saturating_add(u32::from(seen)), Ordering::Relaxed);
    }
}

/// Errors of both banks since the start.
pub fn counts() -> [Errors; 2] {
    [0, 1].map(|bank| {
        take(bank);
        Errors {
            corrected: COUNTERS[bank].corrected.load(Ordering::Relaxed),
            failed: COUNTERS[bank].failed.load(Ordering::Relaxed),
        }
    })
}

/// The flash word at `address`, a multiple of [`WORD_BYTES`] within the flash; none if it cannot be read.
pub fn read_word(address: u32) -> Option<[u8; WORD_BYTES]> {
    let word = stylus_boot::word::read(address);
    if word.is_none() {
        // The return value reports the error, so the flags of the error are counted and cleared. Each bank has its own
        // flags.
        for bank in 0..2 {
            take(bank);
        }
    }
    word
}
