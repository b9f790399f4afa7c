//! Geometry of the STM32H743's flash.

pub use stylus_boot::map::{BANK_BYTES, SECTOR_BYTES, WORD_BYTES};
