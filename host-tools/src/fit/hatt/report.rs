//! The account of an import: the errors of the conversion, place by place.

use serde::Serialize;

use super::comparison::PlaceError;
use super::convert::{Converted, ConvertedNode};
use super::import::Source;

/// Error of a node that is worth a warning, dB.
const WARN_DB: f64 = 1.0;

/// The account of one texture.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// Name of the texture.
    pub texture: String,
    /// Notes on its file.
    pub warnings: Vec<String>,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// Its nodes.
    pub nodes: Vec<ConvertedNode>,
    /// Errors at the models' own places.
    pub own_places: Vec<PlaceError>,
    /// Errors between them.
    pub between: Vec<PlaceError>,
}

impl ImportReport {
    /// The account of what was `converted` from `source`.
    pub fn of((source, converted): (Source, Converted)) -> Self {
        Self {
            texture: source.name,
            warnings: source.toolkit.warnings,
            speeds_mm_s: converted.spec.speed_axis_mm_s,
            forces_n: converted.spec.force_axis_n,
            nodes: converted.nodes,
            own_places: converted.own,
            between: converted.between,
        }
    }
}

/// A warning of nodes that are not what the file says.
pub fn far_nodes(nodes: &[ConvertedNode]) -> Option<String> {
    let error = |node: &ConvertedNode| {
        let (band, level) = (
            node.worst_band_db.unwrap_or(0.0),
            node.level_db.unwrap_or(0.0),
        );
        band.max(level.abs())
    };
    let far = nodes.iter().filter(|node| error(node) > WARN_DB).count();
    let worst = nodes.iter().max_by(|a, b| error(a).total_cmp(&error(b)))?;
    (far > 0).then(|| {
        format!(
            "{far} of {} nodes are more than {WARN_DB} dB from the file, by up to {:.1} dB in a third octave at {} \
             mm/s, {} N",
            nodes.len(),
            error(worst),
            worst.speed_mm_s,
            worst.force_n
        )
    })
}
