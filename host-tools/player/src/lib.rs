#![doc = include_str!("../README.md")]

mod choice;
mod follow;
mod handover;
mod library;
mod mailbox;
mod motion;
mod player;
mod playing;
mod resampler;
mod stages;

pub use choice::{ChoiceError, Selection, Without, plan_of};
pub use library::SharedLibrary;
pub use motion::{BLOCK_NUMBERS, BlockMotion};
pub use player::{Fault, Filler, HELD_S, Mover, band_hz, latency_s, player, player_as_rendered};
pub use playing::Playing;
pub use resampler::{Filter, delay_s};
