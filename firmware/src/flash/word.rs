//! Reads of a flash word that may not be readable, with their errors counted.

use stylus_app::flash::WORD_BYTES;

use crate::flash::errors;

/// The flash word at `address`, a multiple of [`WORD_BYTES`] within the flash; none if it cannot be read.
pub fn read(address: u32) -> Option<[u8; WORD_BYTES]> {
    let word = stylus_boot::word::read(address);
    if word.is_none() {
        // The return value reports the error, so its flags are counted and cleared. Each bank has its own.
        for bank in 0..2 {
            errors::take(bank);
        }
    }
    word
}
