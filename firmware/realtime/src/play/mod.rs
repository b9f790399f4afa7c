//! Decides what is played, at a lower priority than the tick: one block every 2 ms, from the library in RAM, handed to
//! the tick.
//!
//! Invariant: everything shared with the tick has one owner at any time, by the protocol at the beginning of its
//! module. No lock is taken.

pub mod direction;
pub mod library_ram;
pub mod shared;
pub mod update;
pub mod voice;
