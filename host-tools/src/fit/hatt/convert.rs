//! From scattered ARMA models at 1 kHz to AR models at 5 kHz over a rectangle.
//!
//! Up to half their own rate the models' spectrum is kept. Above, where they say nothing, it goes on from its mean
//! level in the last tenth below and falls by [`ROLL_OFF_DB_PER_OCTAVE`]: no power to speak of, and no edge that a
//! model would ring at. Every node has the lowest order that keeps all third octaves within [`ORDER_TOLERANCE_DB`].

use model_format::{FadeLaw, Laws, LevelLaw, Library, NodeFlags, Provenance, TextureSpec, encode};
use serde::Serialize;

pub use super::axes::Bounds;
use super::axes::{Candidates, Chosen, choose};
pub use super::between::ORDER_TOLERANCE_DB;
pub use super::between::ROLL_OFF_DB_PER_OCTAVE;
use super::comparison::{PlaceError, errors};
use super::toolkit::Toolkit;
use crate::support::error::{Error, Result};
use crate::texture::grid::Grid;
use crate::texture::library::texture_spec;
use crate::texture::quantise::coarse;

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

/// Error of a node that is worth a warning, dB.
const WARN_DB: f64 = 1.0;

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

/// Makes the models of `toolkit` a texture named `name`, whose grid keeps `bounds`. Errors are of the bytes that
/// the texture becomes.
///
/// # Errors
/// No speed or no force above zero, or a level that the library cannot hold.
pub fn convert(name: &str, toolkit: &Toolkit, bounds: Bounds) -> Result<Converted> {
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
    } = choose(toolkit, &candidates, bounds);
    let grid = Grid {
        speeds_mm_s,
        forces_n,
        models,
        laws: LAWS,
        // Published models hold neither a residual nor a place.
        parts: model_format::PartsSpec::default(),
    };
    let mut spec = texture_spec(name, Provenance::Recorded, &grid)?;
    // Models of 1 kHz have no line so narrow that it needs 24 bits of θ, and the slot holds more nodes without.
    spec.nodes = coarse(spec.nodes);
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
        .zip(errors(toolkit, &texture, &node_places))
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
    let judged: Vec<(f64, f64)> = toolkit.inside_triangles(JUDGED_WEIGHTS).collect();
    let own: Vec<(f64, f64)> = toolkit.model_places().collect();
    let sounding = |places: &[(f64, f64)]| {
        errors(toolkit, &texture, places)
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

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::super::read::read;
    use super::*;
    use std::path::Path;

    const ROOM: Bounds = Bounds {
        speeds: 64,
        forces: 64,
        bytes: usize::MAX,
    };

    fn converted(text: &str, bounds: Bounds) -> Converted {
        let toolkit = read(Path::new("felt.xml"), text).unwrap();
        convert("felt", &toolkit, bounds).unwrap()
    }

    /// Errors of a converted texture at these places.
    fn errors_at(converted: &Converted, text: &str, places: &[(f64, f64)]) -> Vec<PlaceError> {
        let bytes = encode(std::slice::from_ref(&converted.spec)).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let texture = library.texture("felt").unwrap();
        let toolkit = read(Path::new("felt.xml"), text).unwrap();
        let errors = errors(&toolkit, &texture, places);
        errors.into_iter().flatten().collect()
    }

    #[test]
    fn with_room_the_grid_holds_every_model_at_its_own_place() {
        let converted = converted(&fixture::whole(), ROOM);
        assert_eq!(converted.spec.speed_axis_mm_s, [60.0, 140.0, 200.0]);
        assert_eq!(converted.spec.force_axis_n, [0.5, 1.3, 2.0]);
        assert_eq!(converted.own.len(), 3);
        for error in &converted.own {
            assert!(error.level_db.abs() < 0.01, "{error:?}");
            assert!(
                error.worst_band_db() < ORDER_TOLERANCE_DB + 0.05,
                "{error:?}"
            );
        }
        for node in &converted.nodes {
            assert!(node.level_db.unwrap().abs() < 0.01, "{node:?}");
            assert!(!node.is_extrapolated);
        }
    }

    #[test]
    fn a_grid_keeps_its_bounds_and_loses_the_lines_that_matter_least() {
        let text = fixture::scattered(12);
        let whole = converted(&text, ROOM);
        let few = Bounds {
            speeds: 6,
            forces: 7,
            ..ROOM
        };
        let smaller = converted(&text, few);
        assert_eq!(smaller.spec.speed_axis_mm_s.len(), 6);
        assert_eq!(smaller.spec.force_axis_n.len(), 7);
        let size =
            |converted: &Converted| encode(std::slice::from_ref(&converted.spec)).unwrap().len();
        let tight = converted(
            &text,
            Bounds {
                bytes: 1000,
                ..ROOM
            },
        );
        assert!(size(&tight) <= 1000 + 80, "{}", size(&tight));
        assert!(size(&tight) < size(&whole));
        // Shapes of these models glide with the speed, so that every other of them tells the others.
        let worst = |errors: &[PlaceError]| {
            errors
                .iter()
                .fold(0.0, |worst: f64, e| worst.max(e.level_db.abs()))
        };
        assert!(worst(&whole.own) < 0.01);
        assert!(worst(&smaller.own) < 1.5, "{}", worst(&smaller.own));
    }

    #[test]
    fn below_the_lowest_speed_and_force_the_level_is_that_of_the_file() {
        let text = fixture::whole();
        let converted = converted(&text, ROOM);
        let shares = [0.2, 0.4, 0.6];
        let places: Vec<(f64, f64)> = shares
            .iter()
            .flat_map(|share| [(60.0, 0.5 * share), (60.0 * share, 0.5)])
            .collect();
        let errors = errors_at(&converted, &text, &places);
        assert_eq!(errors.len(), places.len());
        for error in errors {
            // The axis of speeds also turns the shape towards that at 200 mm/s, which is silent without force.
            assert!(error.level_db.abs() < 0.6, "{error:?}");
        }
    }

    #[test]
    fn the_errors_tell_a_library_that_is_not_the_files() {
        let text = fixture::whole();
        let louder = converted(&text.replace("<var>0.004", "<var>0.016"), ROOM);
        let error = &errors_at(&louder, &text, &[(60.0, 0.5)])[0];
        assert!(
            (error.level_db - 20.0 * 2f64.log10()).abs() < 0.02,
            "{error:?}"
        );
        // One triangle of six, the misreading that an error against one's own reading does not see.
        let one = fixture::file(&fixture::PLACES, &fixture::TRIANGLES[..1]);
        let misread = converted(&one, ROOM);
        let errors = errors_at(&misread, &text, &[(140.0, 1.3), (200.0, 2.0)]);
        assert!(
            errors.iter().any(|error| error.level_db.abs() > 2.0),
            "{errors:?}"
        );
    }

    #[test]
    fn little_power_is_made_above_the_models_half_rate() {
        let text = fixture::whole();
        let converted = converted(&text, ROOM);
        let bytes = encode(std::slice::from_ref(&converted.spec)).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let density = super::super::comparison::played_density(
            &library.texture("felt").unwrap(),
            (140.0, 1.3),
        );
        let (below, above): (f64, f64) =
            (density[..=500].iter().sum(), density[600..].iter().sum());
        assert!(above < 0.01 * below, "{above} {below}");
    }

    #[test]
    fn a_file_without_a_speed_or_a_force_is_refused() {
        let text = fixture::file(
            &[(0.0, 0.0, 0.1), (0.0, 1.0, 0.1), (0.0, 2.0, 0.1)],
            &[[1, 2, 3]],
        );
        let toolkit = read(Path::new("felt.xml"), &text).unwrap();
        assert!(convert("felt", &toolkit, ROOM).is_err());
    }
}
