//! From recordings to what a library holds: fits, textures before they are bytes, and scenes.
//!
//! Invariant: the same recordings and options give the same bytes on every machine, with any number of threads.

// The wings below, by the names that this crate has for them.
#[cfg(test)]
use stylus_signals::rig;
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_support as support};

pub mod fit;
pub mod scene;
pub mod texture;
