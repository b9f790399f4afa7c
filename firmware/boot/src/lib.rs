//! The stylus's bootloader, and what it shares with the image.
//!
//! The bootloader lies in the first sector of bank 1 and is never erased by an update. At each reset it reads the
//! [record] of updates. Usually there is nothing to do, and it jumps to the image. After an update was committed, it
//! exchanges the active image with the new one, which waits in a slot of bank 2, and jumps to the new image, which is
//! then on trial. A reset before the new image is confirmed exchanges the two back.
//!
//! `embassy-boot` does the exchange, but it does not store its state itself, because it would erase the sector of its
//! state in place. If power is lost during that erasure, the words with the progress can be gone while the word that
//! asks for the exchange is still there. Half of the exchange is then done twice, which destroys both images. Here the
//! state is 16 bytes of a record, and every change of the state is a new record in a new word of the flash
//! ([`record::Store`]).
//!
//! Invariant: from the bootloader's first instructions on (`first`), the amplifier is off and the output at mid-scale,
//! also while images are exchanged.
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
