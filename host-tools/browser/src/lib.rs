#![doc = include_str!("../README.md")]

mod fault;
mod session;

#[cfg(target_arch = "wasm32")]
mod exports;

pub use fault::{Fault, MOST_BLOCKS};
pub use session::{MOST_SAMPLES, STATE_NUMBERS, Session, VOICE_NUMBERS, motion_of_digest};
pub use stylus_player::{BLOCK_NUMBERS, BlockMotion, Selection, Without};
