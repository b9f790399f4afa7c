#![doc = include_str!("../README.md")]

pub mod dsp;
pub mod evaluation;
pub mod export;
pub mod fit;
pub mod link;
pub mod playing;
pub mod procedures;
pub mod recording;
pub mod report;
pub mod rig;
pub mod scene;
pub mod support;
pub mod texture;
