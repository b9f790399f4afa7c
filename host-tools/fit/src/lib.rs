//! From recordings to the content of a library: fits, textures before they are encoded, and scenes.
//!
//! Invariant: the same recordings and options give the same bytes on every machine, with any number of threads.

// Parts of the crates that this one uses, by the names that they have here.
#[cfg(test)]
use stylus_signals::rig;
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_support as support};

pub mod fit;
pub mod scene;
pub mod texture;
