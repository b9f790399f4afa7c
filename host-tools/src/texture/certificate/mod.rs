//! Stability of a texture at every point of its grid: what is proved of each cell, and what is sampled besides.
//!
//! **Normalised lattice, proved.** Every stored |θ| is below π/2 (the decoder refuses the code of π/2), and a weighted mean of
//! such θ is too, so every rotation that can be asked for is one of those between ∓π/2. The kernel's rotations do not
//! lengthen a vector, in the integers themselves, for any θ (a test of the kernel's goes through all 2²⁴ of them), so the
//! state's norm cannot grow, under any motion. Powers are within the library's bound, so that nothing saturates that
//! the level could prevent.
//!
//! **Direct form, proved.** At a point of a cell the filter is 1/A with A = Σ w(k) A(k), a weighted mean of the cell's nodes,
//! rounded to the kernel's coefficients: that moves |A| by no more than half a step a tap, which all distances from 0 here
//! leave room for.
//! 1. On no edge of the cell (four sides, two diagonals) does A have a zero on the unit circle: for no frequency is 0 on
//!    the segment from A(j) to A(k) in the complex plane, which is the segment lemma's condition that A(j)/A(k) is never
//!    real and negative. This is shown for whole intervals of frequency, not at samples: in an interval every A(k) stays
//!    in a disc about its value in the middle, whose radius follows from three derivatives there and a bound on the
//!    fourth, and the segments are farther from 0 than those discs reach. Intervals are halved until they are.
//! 2. The first node's A turns around 0 no time while the frequency goes around the circle, so that 1/A is stable there.
//! 3. Then 1/A is stable at every point. For A's values at one frequency fill at most the convex hull of the four A(k), whose
//!    border is made of edges. At 0 Hz the hull is a real interval whose ends are on edges, so 0 is outside; as the
//!    frequency goes on 0 would have to cross an edge to come in. No zero ever reaches the circle, and none is outside
//!    it at the first node. (This is the edge theorem of Bartlett, Hollot and Lin, 1988, for this case.)
//!
//! The nodes are the stored coefficients, exactly; the evaluation is in float64 with an allowance for its rounding.
//!
//! **Direct form, sampled.** [`SAMPLES_A_SIDE`] + 1 by as many points of the cell, at weights that the kernel can have, by
//! another way: the step-down recursion in float64. It tells the largest pole radius among these points. A texture is
//! certified only if both agree.
//!
//! **Direct form, not shown.** All this is about a filter whose coefficients rest. While they change, a direct form's state
//! can grow though all its points are stable; and rounding and saturation can keep an oscillation alive. `stylus stress`
//! shows both.

mod circle;
mod edges;
mod interior;

use model_format::{
    CELL_MARGIN_STEPS_PER_OCTAVE, Certificate, Coefficients, DecodeError, Library, Structure,
    THETA_STEP_RAD, Texture, TextureSpec, UNCERTIFIED_CELL, encode_uncertified,
};
use rayon::prelude::*;
use serde::Serialize;
use stylus_kernel::direct::exponent;

use crate::support::error::{Error, Result};

use circle::Circle;

pub use interior::SAMPLES_A_SIDE;

/// What is found of a texture.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The texture's name.
    pub texture: String,
    /// Its structure.
    pub structure: String,
    /// Whether it is computed from a simulated rig's recordings.
    pub simulated: bool,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// All cells, speed-major.
    pub cells: Vec<Cell>,
    /// Whether every cell holds.
    pub holds: bool,
    /// Whether the library holds a certificate, and the same one.
    pub stored: Stored,
}

/// The certificate that a library holds, beside the one just found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stored {
    /// There is none.
    Missing,
    /// It says what was found.
    Same,
    /// It does not.
    Different,
}

/// What lies between neighbouring nodes.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// Lowest and highest speed, mm/s; equal where the axis has one value.
    pub speeds_mm_s: [f32; 2],
    /// Lowest and highest force, N.
    pub forces_n: [f32; 2],
    /// What was found.
    pub finding: Finding,
}

/// What was found of a cell.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Finding {
    /// Of a normalised lattice.
    Lattice {
        /// Largest reflection coefficient's magnitude of the cell's nodes, which no point between them exceeds.
        largest_reflection: f64,
    },
    /// Of a direct form.
    Direct {
        /// A proved lower bound, over the whole cell and the whole unit circle, of |A|: coefficients off by less, added up,
        /// would be stable too. `None` where the proof fails.
        proved_margin: Option<f64>,
        /// Where the proof came no further, Hz.
        critical_frequency_hz: Option<f64>,
        /// The sampled point of the largest pole radius.
        worst: Point,
    },
}

/// A point of the grid and the filter there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Largest magnitude of a pole; 1/A is stable where it is below one.
    pub pole_radius: f64,
}

impl Cell {
    /// Whether every point of the cell is stable, as far as it is proved and sampled.
    pub fn holds(&self) -> bool {
        match &self.finding {
            Finding::Lattice { .. } => true,
            Finding::Direct {
                proved_margin,
                worst,
                ..
            } => proved_margin.is_some() && worst.pole_radius < 1.0,
        }
    }

    /// The byte that a library stores.
    fn stored_margin(&self) -> u8 {
        match self.finding {
            Finding::Direct {
                proved_margin: Some(margin),
                ..
            } if self.holds() => {
                let steps = -margin.log2() * f64::from(CELL_MARGIN_STEPS_PER_OCTAVE);
                // Up, so that what is stored is proved; a margin above one is as good as one.
                steps.ceil().clamp(0.0, f64::from(UNCERTIFIED_CELL)) as u8
            }
            _ => UNCERTIFIED_CELL,
        }
    }
}

impl std::fmt::Display for Cell {
    /// Where the cell is, and what is wrong with it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([low_speed, high_speed], [low_force, high_force]) = (self.speeds_mm_s, self.forces_n);
        write!(
            f,
            "cell {low_speed} to {high_speed} mm/s, {low_force} to {high_force} N"
        )?;
        let Finding::Direct {
            critical_frequency_hz,
            worst,
            ..
        } = &self.finding
        else {
            return Ok(());
        };
        write!(
            f,
            ", worst at {:.4} mm/s, {:.4} N with pole radius {:.5}",
            worst.speed_mm_s, worst.force_n, worst.pole_radius
        )?;
        match critical_frequency_hz {
            Some(frequency) if worst.pole_radius < 1.0 => {
                write!(
                    f,
                    ", all samples stable, but no proof beyond {frequency:.1} Hz"
                )
            }
            _ => Ok(()),
        }
    }
}

impl Report {
    /// The cells that do not hold, the one with the largest pole radius first.
    pub fn failures(&self) -> Vec<&Cell> {
        let mut failures: Vec<&Cell> = self.cells.iter().filter(|cell| !cell.holds()).collect();
        let radius = |cell: &Cell| match &cell.finding {
            Finding::Direct { worst, .. } => worst.pole_radius,
            Finding::Lattice { .. } => 0.0,
        };
        failures.sort_by(|a, b| radius(b).total_cmp(&radius(a)));
        failures
    }

    /// What a library stores of a direct form: a byte a cell. Nothing of a lattice, which needs nothing stored.
    pub fn cell_margins(&self) -> Vec<u8> {
        let direct = |cell: &&Cell| matches!(cell.finding, Finding::Direct { .. });
        let direct = self.cells.iter().filter(direct);
        direct.map(Cell::stored_margin).collect()
    }
}

/// Certifies `texture`, whatever is stored with it.
pub fn certify(texture: &Texture<'_>) -> Report {
    let speeds_mm_s: Vec<f32> = texture.speed_axis().values().collect();
    let forces_n: Vec<f32> = texture.force_axis().values().collect();
    let places = places(texture, &speeds_mm_s, &forces_n);
    let findings = match texture.structure() {
        Structure::NormalisedLattice => lattice(texture, &places),
        Structure::DirectForm16 | Structure::DirectForm32 => direct_form(texture, &places),
    };
    let cells = places
        .into_iter()
        .zip(findings)
        .map(|(place, finding)| Cell {
            speeds_mm_s: place.speeds_mm_s,
            forces_n: place.forces_n,
            finding,
        });
    let mut report = Report {
        texture: texture.name().to_owned(),
        structure: texture.structure().to_string(),
        simulated: texture.provenance() == model_format::Provenance::Simulated,
        speeds_mm_s,
        forces_n,
        cells: cells.collect(),
        holds: false,
        stored: Stored::Missing,
    };
    report.holds = report.cells.iter().all(Cell::holds);
    report.stored = match texture.certificate() {
        Certificate::None => Stored::Missing,
        // The decoder has compared it with the nodes.
        Certificate::Lattice { .. } => Stored::Same,
        Certificate::DirectForm { cell_margins } if cell_margins == report.cell_margins() => {
            Stored::Same
        }
        Certificate::DirectForm { .. } => Stored::Different,
    };
    report
}

/// Gives a texture that is to be encoded its certificate.
///
/// # Errors
/// A direct form that is not stable throughout, with the cell and the worst point; nodes that make no library.
pub fn certified(mut spec: TextureSpec) -> Result<TextureSpec> {
    if spec.structure == Structure::NormalisedLattice {
        return Ok(spec);
    }
    let refused = |failure: DecodeError| {
        Error::Model(format!(
            "texture '{}' does not make a library: {failure}",
            spec.name
        ))
    };
    let bytes = encode_uncertified(std::slice::from_ref(&spec)).map_err(refused)?;
    let library = Library::decode_uncertified(&bytes).map_err(refused)?;
    let texture = library.textures().next().expect("one was encoded");
    let report = certify(&texture);
    if let Some((worst, others)) = report.failures().split_first() {
        return Err(Error::Model(format!(
            "texture '{}' is not stable between its nodes in the {}: {worst}{}; fit it as a lattice (--structure lattice), \
             which is stable at every point",
            report.texture,
            report.structure,
            match others.len() {
                0 => String::new(),
                more => format!(" (and {more} more of {} cells)", report.cells.len()),
            }
        )));
    }
    spec.cell_margins = report.cell_margins();
    Ok(spec)
}

/// Where a cell is, and its nodes: index on the speed axis and on the force axis, the kernel's order, none twice.
struct Place {
    speeds_mm_s: [f32; 2],
    forces_n: [f32; 2],
    nodes: Vec<(usize, usize)>,
}

fn places(texture: &Texture<'_>, speeds_mm_s: &[f32], forces_n: &[f32]) -> Vec<Place> {
    let (speed_cells, force_cells) = texture.cell_counts();
    let mut places = Vec::with_capacity(speed_cells * force_cells);
    for speed in 0..speed_cells {
        for force in 0..force_cells {
            let speeds = speed..=(speed + 1).min(speeds_mm_s.len() - 1);
            let forces = force..=(force + 1).min(forces_n.len() - 1);
            places.push(Place {
                speeds_mm_s: [speeds_mm_s[speed], speeds_mm_s[*speeds.end()]],
                forces_n: [forces_n[force], forces_n[*forces.end()]],
                nodes: speeds
                    .flat_map(|speed| forces.clone().map(move |force| (speed, force)))
                    .collect(),
            });
        }
    }
    places
}

fn lattice(texture: &Texture<'_>, places: &[Place]) -> Vec<Finding> {
    let largest = |&(speed, force): &(usize, usize)| match texture.node(speed, force).coefficients {
        Coefficients::Lattice(codes) => codes
            .iter()
            .map(|&code| i16::from_le_bytes(code).unsigned_abs())
            .max()
            .unwrap_or(0),
        Coefficients::Direct16 { .. } | Coefficients::Direct32 { .. } => 0,
    };
    let finding = |place: &Place| Finding::Lattice {
        largest_reflection: place
            .nodes
            .iter()
            .map(largest)
            .max()
            .map_or(0.0, |code| (f64::from(code) * THETA_STEP_RAD).sin()),
    };
    places.iter().map(finding).collect()
}

fn direct_form(texture: &Texture<'_>, places: &[Place]) -> Vec<Finding> {
    let order = texture.max_order();
    let nodes: Vec<_> = texture.nodes().collect();
    let polynomials: Vec<Vec<f64>> = nodes
        .iter()
        .map(|node| polynomial(node.coefficients, order))
        .collect();
    // Half a step of the kernel's coefficients a tap.
    let rounding = order as f64 * 2f64.powi(exponent(texture) as i32 - 32);
    let circles: Vec<Circle> = polynomials.par_iter().map(|a| Circle::new(a)).collect();
    let forces = texture.force_axis().len();
    let rate_hz = f64::from(texture.sample_rate_hz());
    let finding = |place: &Place| {
        let indices = || {
            place
                .nodes
                .iter()
                .map(|(speed, force)| speed * forces + force)
        };
        let corners: Vec<&Circle> = indices().map(|index| &circles[index]).collect();
        let proof = edges::prove(&corners, rounding);
        let corners: Vec<&[f64]> = indices()
            .map(|index| polynomials[index].as_slice())
            .collect();
        let worst = interior::worst(&corners, place.speeds_mm_s, place.forces_n);
        Finding::Direct {
            proved_margin: proof.ok(),
            critical_frequency_hz: proof.err().map(|rad| rad / std::f64::consts::TAU * rate_hz),
            worst,
        }
    };
    places.par_iter().map(finding).collect()
}

/// a(0) = 1, a(1) ... of A(z) = Σ a(i) z⁻ⁱ, exactly as stored; zeros up to `order`.
fn polynomial(coefficients: Coefficients<'_>, order: usize) -> Vec<f64> {
    let mut polynomial = vec![1.0];
    match coefficients {
        Coefficients::Direct16 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 15);
            polynomial.extend(
                codes
                    .iter()
                    .map(|&h| -f64::from(i16::from_le_bytes(h)) * step),
            );
        }
        Coefficients::Direct32 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 31);
            polynomial.extend(
                codes
                    .iter()
                    .map(|&h| -f64::from(i32::from_le_bytes(h)) * step),
            );
        }
        Coefficients::Lattice(_) => {}
    }
    polynomial.resize(order + 1, 0.0);
    polynomial
}
