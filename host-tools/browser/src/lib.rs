#![doc = include_str!("../README.md")]

mod fault;
mod library_numbers;
mod limits;
mod session;

#[cfg(target_arch = "wasm32")]
mod exports;

pub use fault::Fault;
pub use library_numbers::{scene_numbers, texture_numbers};
pub use limits::{MOST_BLOCKS, MOST_SAMPLES};
pub use session::{
    BLOCK_NUMBERS, BlockMotion, STATE_NUMBERS, Selection, Session, VOICE_NUMBERS, Without,
};
