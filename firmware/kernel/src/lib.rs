#![doc = include_str!("../README.md")]
#![no_std]

pub mod arithmetic;
pub mod digest;
pub mod excitation;
pub mod feed;
mod fixed;
pub mod grid;
pub mod lattice;
pub mod level;
pub mod lines;
mod logarithm;
mod nodes;
pub mod position;
pub mod rotation;
pub mod scene;
mod synthesis;
pub mod theta;
#[cfg(feature = "variants")]
pub mod variants;

pub use grid::{Motion, MotionError};
pub use level::Levels;
pub use synthesis::{
    Frame, MAX_FED_SAMPLES, Playback, Synthesis, UPDATE_INTERVAL_SAMPLES, update_interval_samples,
};
