//! Conversion of scattered ARMA models at 1 or 10 kHz to AR models at 5 or 10 kHz over a rectangle.
//!
//! Up to half the lower rate the models' spectrum is preserved. Models at 1 kHz say nothing above 500 Hz. There the
//! spectrum continues from its mean level in the last tenth below and falls by [`ROLL_OFF_DB_PER_OCTAVE`], which leaves
//! little power and no edge at which a model would ring. Every node has the lowest of several orders that preserves all
//! third octaves within [`ORDER_TOLERANCE_DB`], or the highest of them if none does.

use model_format::{
    FadeLaw, Laws, LevelLaw, Library, MillimetresPerSecond, Newton, NodeFlags, OutputSample, Provenance, Texture,
    TextureSpec, encode,
};
use rayon::prelude::*;
use serde::Serialize;
use stylus_dsp::fourier;
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, BAND_LABELS_HZ, band_edges_hz};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation;
use stylus_kernel::grid::{GridPoint, Motion};
use stylus_kernel::lattice::{LatticeFrame, LatticeState};
use stylus_support::{Error, Result};

use super::axes::{Candidates, Chosen, MOST_BANDS, choose};
use super::between;
use super::toolkit::Toolkit;
use crate::texture::grid::Grid;
use crate::texture::library::texture_spec;
use crate::texture::quantise::coarse;

pub use super::axes::Bounds;
pub use super::between::{ORDER_TOLERANCE_DB, ROLL_OFF_DB_PER_OCTAVE};

/// Nominal frequencies of the third octaves that follow those of [`BAND_LABELS_HZ`], Hz.
const HIGH_LABELS_HZ: [&str; MOST_BANDS - BAND_LABELS_HZ.len()] = ["1250", "1600", "2000", "2500", "3150", "4000"];

/// Weights of the corners for the positions within triangles at which a conversion is judged. The choice of the axes
/// does not use these positions.
const JUDGED_WEIGHTS: [f64; 3] = [0.5, 0.3, 0.2];

/// Laws of the level of HaTT's files: variance is interpolated, even towards silence at rest.
const LAWS: Laws = Laws {
    level: LevelLaw::Power,
    fade: FadeLaw::Power,
};

/// A node, and the errors of its conversion.
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
    /// Largest error of a third octave within the models' own band, dB; `None` where the file is silent, and outside of
    /// all triangles.
    pub worst_band_db: Option<f64>,
    /// Error of the level within the models' own band, dB; `None` where the file is silent, and outside of all
    /// triangles.
    pub level_db: Option<f64>,
    /// True for a position outside of all triangles. It gets the values of the nearest position within one.
    pub is_extrapolated: bool,
}

/// A texture, and the errors of its conversion.
#[derive(Clone, Debug)]
pub struct Converted {
    /// The texture, ready to be encoded.
    pub spec: TextureSpec,
    /// Nodes of the texture, speed-major.
    pub nodes: Vec<ConvertedNode>,
    /// Errors at the positions of the file's models that are not silent and lie in a triangle.
    pub own: Vec<PlaceError>,
    /// Errors at a position within each triangle, which the choice of the axes did not use.
    pub between: Vec<PlaceError>,
}

/// Error of a node above which there is a warning, dB.
const WARN_DB: f64 = 1.0;

/// Returns a warning about nodes that differ from the file by more than 1 dB; `None` if there are none.
pub fn far_nodes(nodes: &[ConvertedNode]) -> Option<String> {
    let error = |node: &ConvertedNode| {
        let (band, level) = (node.worst_band_db.unwrap_or(0.0), node.level_db.unwrap_or(0.0));
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

/// Converts the models of `toolkit` to a texture named `name`, whose grid is within `bounds`. The errors are those of
/// the encoded texture.
///
/// # Errors
/// No speed or no force above zero, `bounds` without a speed or a force, or a texture that the library cannot hold.
pub fn convert(name: &str, toolkit: &Toolkit, bounds: Bounds) -> Result<Converted> {
    let candidates = Candidates::of(toolkit);
    if candidates.0.iter().any(Vec::is_empty) || bounds.speeds == 0 || bounds.forces == 0 {
        let problem = "there is no grid: it needs a model at a speed and a force above zero, and room for a node";
        return Err(Error::Request(problem.into()));
    }
    let Chosen {
        speeds_mm_s,
        forces_n,
        models,
    } = choose(toolkit, &candidates, bounds);
    // Published models come without a residual and without lines tied to position.
    let mut grid = Grid::new(speeds_mm_s, forces_n, models);
    grid.laws = LAWS;
    let mut spec = texture_spec(name, Provenance::Recorded, &grid)?;
    spec.sample_rate_hz = toolkit.play_rate.hz();
    // Published models have no line so narrow that it needs 24 bits of θ, and the slot holds more nodes without them.
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
    let sounding = |places: &[(f64, f64)]| errors(toolkit, &texture, places).into_iter().flatten().collect();
    let (own, between) = (sounding(&own), sounding(&judged));
    Ok(Converted {
        spec,
        nodes,
        own,
        between,
    })
}

/// Error at a position.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaceError {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Error of the level in the band up to half the lower rate, dB.
    pub level_db: f64,
    /// Errors of the third octaves in this band, by their nominal frequencies, dB.
    pub bands_db: Vec<(&'static str, f64)>,
}

/// Summary of the errors at several positions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of positions.
    pub places: usize,
    /// Median magnitude of the levels' errors, dB.
    pub level_median_db: f64,
    /// Magnitude of error that 95 % of the levels do not exceed, dB.
    pub level_95_db: f64,
    /// Largest magnitude of the levels' errors, dB.
    pub level_worst_db: f64,
    /// Fraction of all third octaves whose error is not felt (at most 2.2 dB), %.
    pub unfelt_bands_percent: f64,
    /// Largest magnitude of the third octaves' errors, dB.
    pub band_worst_db: f64,
}

impl PlaceError {
    /// Returns the largest magnitude of the third octaves' errors, dB.
    pub fn worst_band_db(&self) -> f64 {
        self.bands_db
            .iter()
            .fold(0.0, |worst: f64, (_, error)| worst.max(error.abs()))
    }
}

impl Summary {
    /// Returns the summary of `errors`; `None` if there are none.
    pub fn of(errors: &[PlaceError]) -> Option<Self> {
        let mut levels: Vec<f64> = errors.iter().map(|error| error.level_db.abs()).collect();
        levels.sort_by(f64::total_cmp);
        let rank = |share: f64| levels[(share * (levels.len() - 1) as f64).round() as usize];
        let bands = || errors.iter().flat_map(|error| &error.bands_db);
        let unfelt = bands().filter(|(_, error)| error.abs() <= AMPLITUDE_JND_DB).count();
        (!levels.is_empty()).then(|| Self {
            places: errors.len(),
            level_median_db: rank(0.5),
            level_95_db: rank(0.95),
            level_worst_db: rank(1.0),
            unfelt_bands_percent: 100.0 * unfelt as f64 / bands().count().max(1) as f64,
            band_worst_db: errors.iter().map(PlaceError::worst_band_db).fold(0.0, f64::max),
        })
    }
}

/// Compares `texture` with `toolkit` at speeds, mm/s, and forces, N. Returns one result per position: `None` where the
/// file is silent, and outside of all triangles.
pub fn errors(toolkit: &Toolkit, texture: &Texture<'_>, places: &[(f64, f64)]) -> Vec<Option<PlaceError>> {
    places.par_iter().map(|&place| error(toolkit, texture, place)).collect()
}

fn error(toolkit: &Toolkit, texture: &Texture<'_>, place: (f64, f64)) -> Option<PlaceError> {
    let played = played_density(texture, place);
    let highest_hz = toolkit.highest_hz();
    let frequencies_hz: Vec<f64> = (0..played.len())
        .map(|bin| bin as f64)
        .take_while(|&f| f <= highest_hz)
        .collect();
    let wanted = between::density(toolkit, place, &frequencies_hz)?;
    let error = |low_hz: f64, high_hz: f64| {
        let ratio = power_between(&played, low_hz, high_hz) / power_between(&wanted, low_hz, high_hz);
        10.0 * ratio.log10()
    };
    let labels = || BAND_LABELS_HZ.into_iter().chain(HIGH_LABELS_HZ);
    Some(PlaceError {
        speed_mm_s: place.0,
        force_n: place.1,
        level_db: error(0.0, highest_hz),
        bands_db: (toolkit.bands().zip(labels()))
            .map(|(band, label)| {
                let (low, high) = band_edges_hz(band);
                (label, error(low, high))
            })
            .collect(),
    })
}

/// Returns the power between two frequencies, from densities 1 Hz apart, each of which represents half a step to both
/// sides.
fn power_between(density: &[f64], low_hz: f64, high_hz: f64) -> f64 {
    let share = |bin: usize| {
        let at = bin as f64;
        ((at + 0.5).min(high_hz) - (at - 0.5).max(low_hz)).max(0.0)
    };
    density.iter().enumerate().map(|(bin, value)| value * share(bin)).sum()
}

/// Height of the impulse in standard deviations of the excitation, as a power of two: half of full scale.
const HEIGHT_BITS: u32 = 2;

/// Returns the one-sided density, (m/s²)²/Hz, of `texture`, a lattice, at a speed, mm/s, and a force, N, both finite.
/// The frequencies are 0 Hz, 1 Hz and so on to half the sample rate.
pub(super) fn played_density(texture: &Texture<'_>, (speed_mm_s, force_n): (f64, f64)) -> Vec<f64> {
    let motion = Motion::new(MillimetresPerSecond(speed_mm_s as f32), Newton(force_n as f32))
        .expect("speeds and forces of a file are finite");
    // The kernel's own filter, so that its fixed-point errors count.
    let mut frame = LatticeFrame::silent(texture.max_order());
    frame.update::<Portable>(texture, &GridPoint::locate(texture, motion), frame.levels(0), 1);
    let mut state = LatticeState::new();
    let step = f64::from(1u32 << HEIGHT_BITS) * f64::from(1u32 << OutputSample::FRACTION_BITS);
    // A response of 1 s gives densities 1 Hz apart.
    let rate_hz = texture.sample_rate_hz();
    let mut response = vec![0.0; rate_hz as usize];
    let mut excitation = 1 << (excitation::FRACTION_BITS + HEIGHT_BITS);
    for sample in &mut response {
        let (output, _) = state.next_sample::<Portable>(&frame, excitation, 0);
        *sample = f64::from(output.0) / step;
        excitation = 0;
        // What follows is exactly zero.
        if state.is_silent(texture.max_order()) {
            break;
        }
    }
    let spectrum = fourier::forward(&mut response);
    let scale = 2.0 / f64::from(rate_hz);
    spectrum.iter().map(|bin| scale * bin.norm_sqr()).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;
    use test_helpers::near;

    use super::super::fixture;
    use super::super::read::read;
    use super::*;

    const ROOM: Bounds = Bounds {
        speeds: 64,
        forces: 64,
        bytes: usize::MAX,
    };

    fn converted(text: &str, bounds: Bounds) -> Converted {
        let toolkit = read(Path::new("felt.xml"), text).unwrap();
        convert("felt", &toolkit, bounds).unwrap()
    }

    /// Returns the errors of a converted texture at these positions.
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
        let (speeds, forces) = (&converted.spec.speed_axis_mm_s, &converted.spec.force_axis_n);
        assert!([60.0, 140.0, 200.0].iter().all(|own| speeds.contains(own)));
        assert!([0.5, 1.3, 2.0].iter().all(|own| forces.contains(own)));
        assert_eq!(converted.own.len(), 3);
        for error in &converted.own {
            assert!(error.level_db.abs() < 0.01, "{error:?}");
            assert!(error.worst_band_db() < ORDER_TOLERANCE_DB + 0.05, "{error:?}");
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
        assert!(smaller.spec.speed_axis_mm_s.len() <= few.speeds);
        assert!(smaller.spec.force_axis_n.len() <= few.forces);
        let size = |converted: &Converted| encode(std::slice::from_ref(&converted.spec)).unwrap().len();
        let tight = converted(&text, Bounds { bytes: 1000, ..ROOM });
        assert!(size(&tight) <= 1000 + 80, "{}", size(&tight));
        assert!(size(&tight) < size(&whole));
        // The shapes of these models change gradually with the speed, so that every second one is enough to predict the
        // others.
        let worst = |errors: &[PlaceError]| errors.iter().fold(0.0, |worst: f64, e| worst.max(e.level_db.abs()));
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
            // Along the axis of speeds, the shape also changes towards that at 200 mm/s, which is silent without force.
            assert!(error.level_db.abs() < 0.6, "{error:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        /// A grid of only the models' own lines has an error of more than 4 dB in some third octave.
        #[test]
        fn between_models_the_grid_follows_the_file(
            low in (20.0..90.0, 0.2..0.9, 0.002..0.02),
            high in (110.0..190.0, 1.1..1.9, 0.002..0.02),
        ) {
            let mut models = fixture::PLACES;
            (models[4], models[5]) = (low, high);
            let converted = converted(&fixture::file(&models, &fixture::TRIANGLES), ROOM);
            prop_assert_eq!(converted.between.len(), fixture::TRIANGLES.len());
            for error in &converted.between {
                prop_assert!(error.level_db.abs() < 1.0 && error.worst_band_db() < 2.5, "{:?}", error);
            }
        }
    }

    #[test]
    fn the_errors_tell_a_library_that_is_not_the_files() {
        let text = fixture::whole();
        let louder = converted(&text.replace("<var>0.004", "<var>0.016"), ROOM);
        let error = &errors_at(&louder, &text, &[(60.0, 0.5)])[0];
        near(error.level_db, 20.0 * 2f64.log10(), 0.02);
        // One triangle out of six: an error of reading that a comparison with one's own reading does not show.
        let one = fixture::file(&fixture::PLACES, &fixture::TRIANGLES[..1]);
        let misread = converted(&one, ROOM);
        let errors = errors_at(&misread, &text, &[(140.0, 1.3), (200.0, 2.0)]);
        assert!(errors.iter().any(|error| error.level_db.abs() > 2.0), "{errors:?}");
    }

    #[test]
    fn little_power_is_made_above_the_models_half_rate() {
        let text = fixture::whole();
        let converted = converted(&text, ROOM);
        let bytes = encode(std::slice::from_ref(&converted.spec)).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let density = played_density(&library.texture("felt").unwrap(), (140.0, 1.3));
        let (below, above): (f64, f64) = (density[..=500].iter().sum(), density[600..].iter().sum());
        assert!(above < 0.01 * below, "{above} {below}");
    }

    #[test]
    fn a_file_without_a_speed_or_a_force_is_refused() {
        let text = fixture::file(&[(0.0, 0.0, 0.1), (0.0, 1.0, 0.1), (0.0, 2.0, 0.1)], &[[1, 2, 3]]);
        let toolkit = read(Path::new("felt.xml"), &text).unwrap();
        assert!(convert("felt", &toolkit, ROOM).is_err());
    }
}
