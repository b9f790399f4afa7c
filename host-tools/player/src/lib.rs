#![doc = include_str!("../README.md")]

mod choice;
mod exchange;
mod follow;
mod player;
mod playing;
mod resampler;
mod stages;

pub use choice::{ChoiceError, Selection, SharedLibrary, Without, plan_of};
pub use player::{Fault, Filler, HELD_S, Mover, band_hz, latency_s, player, player_as_rendered};
pub use playing::{BLOCK_NUMBERS, BlockMotion, Playing};
pub use resampler::{Filter, delay_s};
