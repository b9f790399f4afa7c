//! The host and a device: the link between them, and procedures of several requests over it.
//!
//! Invariant: nothing here fits a texture.

// The crates below this one, under the names that this crate uses for them.
#[cfg(test)]
use stylus_fit::scene;
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_support as support};

pub mod link;
pub mod procedures;
