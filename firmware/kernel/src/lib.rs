#![doc = include_str!("../README.md")]
#![no_std]

pub mod arithmetic;
pub mod dc_blocker;
pub mod digest;
#[cfg(feature = "direct-form")]
pub mod direct_form;
pub mod excitation;
pub mod feed;
pub mod fixed;
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

pub use grid::{Motion, MotionError};
pub use level::Levels;
pub use synthesis::{Frame, MAX_FED_SAMPLES, Playback, Synthesis, UPDATE_INTERVAL_SAMPLES, update_interval_samples};
