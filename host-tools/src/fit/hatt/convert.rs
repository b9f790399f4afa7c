//! From scattered ARMA models at 1 kHz to AR models at 5 kHz over a rectangle.
//!
//! Up to half their own rate the models' spectrum is kept. Above, where they say nothing, it goes on from its mean
//! level in the last tenth below and falls by [`ROLL_OFF_DB_PER_OCTAVE`]: no power to speak of, and no edge that a
//! model would ring at. Every node has the lowest order that keeps all third octaves within [`ORDER_TOLERANCE_DB`].

use model_format::{FadeLaw, Laws, LevelLaw, Library, NodeFlags, Provenance, TextureSpec, encode};
use serde::Serialize;

pub use super::axes::Bounds;
use super::axes::{Candidates, Chosen, choose};
pub use super::between::ROLL_OFF_DB_PER_OCTAVE;
use super::comparison::{PlaceError, errors};
pub use super::node::ORDER_TOLERANCE_DB;
use super::reference::Reference;
use super::toolkit::Toolkit;
use crate::support::error::{Error, Result};
use crate::texture::certificate;
use crate::texture::grid::Grid;
use crate::texture::library::texture_spec;
use crate::texture::quantise::StructureChoice;

/// Weights of the places within triangles at which a conversion is judged; the choice of the axes sees none of them.
const JUDGED_WEIGHTS: [f64; 3] = [0.5, 0.3, 0.2];

/// Laws of the level of HaTT's files: variance is interpolated, also towards silence at rest.
const LAWS: Laws = Laws {
    level: LevelLaw::Power,
    fade: FadeLaw::Power,
};

/// A node, and what the conversion did to it.
#[derive(Clone, Debug, Serialize)]
pub struct ConvertedNode {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f32,
    /// Normal force, N.
    pub force_n: f32,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// Order of the model.
    pub order: usize,
    /// Largest error of a third octave within the models' own band, dB; none where the file has no sound.
    pub worst_band_db: Option<f64>,
    /// Error of the level within the models' own band, dB; none where the file has no sound.
    pub level_db: Option<f64>,
    /// True for a place outside of all triangles, which takes over the nearest place within.
    pub is_extrapolated: bool,
}

/// A texture and what the conversion did.
#[derive(Clone, Debug)]
pub struct Converted {
    /// The texture, ready to be encoded.
    pub spec: TextureSpec,
    /// Its nodes, speed-major.
    pub nodes: Vec<ConvertedNode>,
    /// Errors at the places of the file's models that sound.
    pub own: Vec<PlaceError>,
    /// Errors at a place within each triangle, which the choice of the axes did not see.
    pub between: Vec<PlaceError>,
}

/// Makes the models of `toolkit` a texture named `name`, whose grid keeps `bounds`. Errors are against `reference`,
/// the same file's definition, and of the bytes that the texture becomes.
///
/// # Errors
/// No speed or no force above zero, or a level that the library cannot hold.
pub fn convert(
    name: &str,
    toolkit: &Toolkit,
    reference: &Reference,
    bounds: Bounds,
) -> Result<Converted> {
    let candidates = Candidates::of(toolkit);
    let axes = [&candidates.speeds_mm_s, &candidates.forces_n];
    if axes.iter().any(|axis| axis.is_empty()) || bounds.speeds == 0 || bounds.forces == 0 {
        let problem = "there is no grid: it needs a model at a speed and a force above zero, and room for a node";
        return Err(Error::Request(problem.into()));
    }
    let Chosen {
        speeds_mm_s,
        forces_n,
        models,
    } = choose(toolkit, reference, &candidates, bounds);
    let grid = Grid {
        speeds_mm_s,
        forces_n,
        models,
        laws: LAWS,
    };
    let spec = texture_spec(name, Provenance::Recorded, &grid, StructureChoice::Lattice)?;
    let spec = certificate::certified(spec)?;
    let refused = |failure| Error::Model(format!("the texture makes no library: {failure}"));
    let bytes = encode(std::slice::from_ref(&spec)).map_err(refused)?;
    let library = Library::decode(&bytes).map_err(refused)?;
    let texture = library.texture(name).expect("the library was made of it");
    let node_places: Vec<(f64, f64)> = grid
        .nodes()
        .map(|(speed, force, _)| (f64::from(speed), f64::from(force)))
        .collect();
    let nodes = grid
        .nodes()
        .zip(errors(reference, &texture, &node_places))
        .map(|((speed_mm_s, force_n, model), error)| ConvertedNode {
            speed_mm_s,
            force_n,
            rms_m_s2: model.output_power.sqrt(),
            order: model.reflection.len(),
            worst_band_db: error.as_ref().map(PlaceError::worst_band_db),
            level_db: error.map(|error| error.level_db),
            is_extrapolated: model.flags.contains(NodeFlags::EXTRAPOLATED),
        })
        .collect();
    let judged: Vec<(f64, f64)> = reference.inside_triangles(JUDGED_WEIGHTS).collect();
    let own: Vec<(f64, f64)> = reference.model_places().collect();
    let sounding = |places: &[(f64, f64)]| {
        errors(reference, &texture, places)
            .into_iter()
            .flatten()
            .collect()
    };
    let (own, between) = (sounding(&own), sounding(&judged));
    Ok(Converted {
        spec,
        nodes,
        own,
        between,
    })
}
