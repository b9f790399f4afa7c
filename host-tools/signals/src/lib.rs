//! Signals that are recorded, simulated or played, and their files.
//!
//! Invariant: nothing here knows how a texture is fitted, or talks to a device.

pub mod export;
pub mod playing;
pub mod recording;
pub mod rig;
