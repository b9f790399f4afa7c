//! Signals that are recorded, simulated or played, and their files.
//!
//! Invariant: nothing here knows how a texture is fitted, or talks to a device.

// The wings below this one, under the names that this crate uses.
use {stylus_dsp as dsp, stylus_support as support};

pub mod export;
pub mod playing;
pub mod recording;
pub mod rig;
