#![doc = include_str!("../README.md")]

mod session;

#[cfg(target_arch = "wasm32")]
mod exports;

pub use session::{Fault, MOST_BLOCKS, MOST_SAMPLES, STATE_NUMBERS, Session, VOICE_NUMBERS, motion_of_digest};
pub use stylus_player::{BLOCK_NUMBERS, BlockMotion, Selection, Without};
