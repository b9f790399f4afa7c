//! Properties of the host's parsers of files, tables, texts and frames.

mod fitted;
mod frame;
mod large;
mod place;
pub mod seeds;
mod table;
mod texts;

use host_tools::support::bounded_file::Format;

use crate::Judge;

/// The targets by their names.
pub const TARGETS: [(&str, Judge); 12] = [
    ("trials", fitted::list),
    ("recordings", fitted::recording),
    ("tables", table::judge),
    ("scenes", texts::scene),
    ("rigs", texts::rig),
    ("hatt", fitted::hatt),
    ("frames", frame::judge),
    ("settings", texts::settings),
    ("records", texts::record),
    ("updates", place::update),
    ("listings", place::listing),
    ("large", large::judge),
];

/// Returns the target that reads `format`; none for a partial result, whose hash refuses any changed byte.
// Without a pattern for the rest, so that a new format does not compile before it has a target.
pub const fn target_of(format: Format) -> Option<&'static str> {
    Some(match format {
        Format::Wave | Format::Table | Format::LabView => "recordings",
        Format::Strokes | Format::Plan | Format::Motion | Format::Answers => "tables",
        Format::Trials => "trials",
        Format::Scene => "scenes",
        Format::Rig => "rigs",
        Format::Hatt => "hatt",
        Format::Library => "decode",
        Format::Record => "records",
        Format::Update => "updates",
        Format::Listing => "listings",
        Format::Partial => return None,
    })
}
