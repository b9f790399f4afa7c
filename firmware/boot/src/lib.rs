//! The stylus's bootloader, and what it shares with the image.
//!
//! The bootloader lies in the first sector of bank 1 and is never erased by an update. At each reset it reads the
//! [record] of updates. Mostly it finds nothing to do and jumps to the image. After an update was committed it
//! exchanges the active image with the one that waits in a slot of bank 2, and jumps to it: the trial. A reset before
//! the new image is confirmed exchanges them back.
//!
//! The exchange is `embassy-boot`'s. Its state is not, because `embassy-boot` erases the sector of its state in place:
//! if power is lost during that, words with progress can be gone while the word that asks for the exchange is still
//! there, and half of an exchange is done twice, which destroys both images. Here its state is 16 bytes of a record,
//! and every change of it is a new record in a new word of the flash ([`record::Store`]).
//!
//! Invariant: from its first instructions on, the amplifier is off and the output at mid-scale (`first`), also while
//! images are exchanged.
#![no_std]

#[cfg(test)]
extern crate std;

#[cfg(target_arch = "arm")]
pub mod first;
#[cfg(feature = "loader")]
pub mod loader;
pub mod map;
pub mod record;
#[cfg(all(target_arch = "arm", feature = "hardware"))]
pub mod registers;
#[cfg(all(target_arch = "arm", feature = "hardware"))]
pub mod supply;
#[cfg(all(target_arch = "arm", feature = "hardware"))]
pub mod word;
