//! Geometry of the STM32H743's flash, and the places in it that bootloader and image share, as in `memory.x`. Offsets
//! count from the start of the flash.

use core::ops::Range;

/// Address of the flash.
pub const FLASH: u32 = 0x0800_0000;

/// Flash word, bytes: the unit that is programmed at once and has one error-correcting code (RM0433 section 4.3.9).
pub const WORD_BYTES: usize = 32;

/// Sector, bytes: the smallest unit that can be erased (RM0433 table 8).
pub const SECTOR_BYTES: usize = 128 * 1024;

/// Bank, bytes. One of the two banks can be read while the other is erased or programmed.
pub const BANK_BYTES: usize = 1024 * 1024;

const fn sectors(first: u32, count: u32) -> Range<u32> {
    first * SECTOR_BYTES as u32..(first + count) * SECTOR_BYTES as u32
}

/// The bootloader.
pub const BOOTLOADER: Range<u32> = sectors(0, 1);

/// The image that runs.
pub const ACTIVE: Range<u32> = sectors(1, 3);

/// The two sectors of the record of updates.
pub const RECORDS: Range<u32> = sectors(4, 2);

/// The two slots of bank 2. The slot that is not active receives an update, and keeps the previous image afterwards.
pub const SLOTS: [Range<u32>; 2] = [sectors(8, 4), sectors(12, 4)];

/// Offset of the bootloader's version, behind its vector table: [`VERSION_MAGIC`], then three numbers of 32 bits.
pub const BOOTLOADER_VERSION: u32 = 0x400;

/// First word of the bootloader's version.
pub const VERSION_MAGIC: u32 = u32::from_le_bytes(*b"STYB");
