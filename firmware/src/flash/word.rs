//! Reads of a flash word that may be unreadable; its errors are counted.

use stylus_app::flash::WORD_BYTES;

use crate::flash::errors;

/// The flash word at `address`, a multiple of [`WORD_BYTES`] within the flash; none if it cannot be read.
pub fn read(address: u32) -> Option<[u8; WORD_BYTES]> {
    let word = stylus_boot::word::read(address);
    if word.is_none() {
        // The return value reports the error, so the flags of the error are counted and cleared. Each bank has its own
        // flags.
        for bank in 0..2 {
            errors::take(bank);
        }
    }
    word
}
