//! Properties of the host's parsers of files, tables, texts and frames.

mod fitted;
mod frame;
mod place;
pub mod seeds;
mod table;
mod texts;

use crate::Judge;

/// The targets by their names.
pub const TARGETS: [(&str, Judge); 9] = [
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
