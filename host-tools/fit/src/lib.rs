//! From recordings to the content of a library: fits, textures before they are encoded, and scenes.
//!
//! Invariant: the same recordings and options give the same bytes, with any number of threads, on all processors with
//! the same vector instructions. Others round the transforms differently.

// Parts of the crates that this one uses, by the names that they have here.
#[cfg(test)]
use stylus_signals::rig;
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_support as support};

pub mod fit;
pub mod scene;
pub mod texture;
