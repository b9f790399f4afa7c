//! Properties of the decoder, the lattice and the host's parsers, each for any bytes: no panic; what is accepted is
//! within its bounds, and comes back from what a writer makes of it; what is refused is named with its file and place.
//!
//! Memory and time are libFuzzer's to bound: see `smoke`.

mod decode;
mod fitted;
mod frame;
mod motion;
mod place;
pub mod seeds;
mod table;
mod texts;

/// A target: judges any bytes, and panics if a property does not hold.
pub type Judge = fn(&[u8]);

/// The targets by their names.
pub const TARGETS: [(&str, Judge); 11] = [
    ("decode", decode::judge),
    ("motion", motion::judge),
    ("trials", fitted::list),
    ("recordings", fitted::recording),
    ("tables", table::judge),
    ("scenes", texts::scene),
    ("rigs", texts::rig),
    ("hatt", fitted::hatt),
    ("frames", frame::judge),
    ("settings", texts::settings),
    ("records", texts::record),
];
