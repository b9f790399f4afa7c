//! The two flash banks behind the NorFlash traits: bank 2 holds the library slots, bank 1 the settings and the record
//! of updates.
//!
//! Invariant: a word that cannot be read is an error and never a bus fault, every wait is bounded, and nothing outside
//! the slots, the settings and the record of updates is erased or written.

pub mod banks;
pub mod errors;
pub mod word;
