//! Properties of the host's parsers, each for any bytes: no panic; what is accepted is within its bounds, and comes
//! back from what a writer makes of it; what is refused is named with its file and place.
//!
//! Memory and time are libFuzzer's to bound: see `smoke`.

pub mod configuration;
pub mod frame;
pub mod hatt;
pub mod list;
mod place;
pub mod record;
pub mod recording;
pub mod rig;
pub mod scene;
pub mod setting;
pub mod table;
