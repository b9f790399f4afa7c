#![doc = include_str!("../README.md")]

mod fault;
mod session;

#[cfg(target_arch = "wasm32")]
mod exports;

pub use fault::{Fault, MOST_BLOCKS};
pub use session::{
    BLOCK_NUMBERS, BlockMotion, MOST_SAMPLES, STATE_NUMBERS, Selection, Session, VOICE_NUMBERS,
    Without,
};
