//! Geometry of the STM32H743's flash.

/// Flash word, bytes: the unit that is programmed at once and has one error-correcting code (RM0433 section 4.3.9).
pub const WORD_BYTES: usize = 32;

/// Sector, bytes: the least that can be erased (RM0433 table 8).
pub const SECTOR_BYTES: usize = 128 * 1024;

/// Bank, bytes. One of the two can be read while the other is erased or programmed.
pub const BANK_BYTES: usize = 1024 * 1024;
