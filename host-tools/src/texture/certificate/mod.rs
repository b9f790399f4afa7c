//! Stability of a texture at every point of its grid: what is proved of each cell, and what is sampled besides.
//!
//! **Normalised lattice, proved.** Every stored |θ| is below π/2 (the decoder refuses the code of π/2), and a weighted
//! mean of such θ is too, so every rotation that can be asked for is one of those between ∓π/2. The kernel's rotations
//! do not lengthen a vector, in the integers themselves, for any θ (a test of the kernel's goes through all 2²⁴ of
//! them), so the state's norm cannot grow, under any motion. Powers are within the library's bound, so that nothing
//! saturates that the level could prevent.
//!
//! **Direct form, proved.** At a point of a cell the filter is 1/A with A = Σ w(k) A(k), a weighted mean of the cell's
//! nodes, rounded to the kernel's coefficients: that moves |A| by no more than half a step per tap, which all distances
//! from 0 here leave room for.
//! 1. On no edge of the cell (four sides, two diagonals) does A have a zero on the unit circle: for no frequency is 0
//!    on the segment from A(j) to A(k) in the complex plane, which is the segment lemma's condition that A(j)/A(k) is
//!    never real and negative. This is shown for whole intervals of frequency, not at samples: in an interval every
//!    A(k) stays in a disc about its value in the middle, whose radius follows from three derivatives there and a bound
//!    on the fourth, and the segments are farther from 0 than those discs reach. Intervals are halved until they are.
//! 2. The first node's A turns around 0 no time while the frequency goes around the circle, so that 1/A is stable
//!    there.
//! 3. Then 1/A is stable at every point. For A's values at one frequency fill at most the convex hull of the four A(k),
//!    whose border is made of edges. At 0 Hz the hull is a real interval whose ends are on edges, so 0 is outside; as
//!    the frequency goes on 0 would have to cross an edge to come in. No zero ever reaches the circle, and none is
//!    outside it at the first node. (This is the edge theorem of Bartlett, Hollot and Lin, 1988, for this case.)
//!
//! The nodes are the stored coefficients, exactly; the evaluation is in float64 with an allowance for its rounding.
//!
//! **Direct form, sampled.** [`SAMPLES_PER_SIDE`] + 1 by as many points of the cell, at weights that the kernel can
//! have, by another way: the step-down recursion in float64. It tells the largest pole radius among these points. A
//! texture is certified only if both agree.
//!
//! **Direct form, not shown.** All this is about a filter whose coefficients rest. While they change, a direct form's
//! state can grow though all its points are stable; and rounding and saturation can keep an oscillation alive. `stylus
//! stress` shows both.

mod circle;
mod edges;
mod finding;
mod interior;

use model_format::{
    Certificate, Coefficients, DecodeError, FINE_THETA_STEP_RAD, Library, Structure, Texture,
    TextureSpec, encode_uncertified,
};
use rayon::prelude::*;
use stylus_kernel::direct::exponent;

use crate::support::error::{Error, Result};
use crate::texture::stored::predictor;

use circle::Circle;

pub use finding::{Cell, Certification, Finding, Point, Stored};
pub use interior::SAMPLES_PER_SIDE;

/// Certifies `texture`, whatever is stored with it.
pub fn certify(texture: &Texture<'_>) -> Certification {
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
    let mut report = Certification {
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
    // Encoded and decoded here although the library is encoded again later, because the certificate is then of bytes
    // that the one validator accepts. That takes less than a hundredth of the proof's time.
    let bytes = encode_uncertified(std::slice::from_ref(&spec)).map_err(refused)?;
    let library = Library::decode_uncertified(&bytes).map_err(refused)?;
    let texture = library.textures().next().expect("one was encoded");
    let report = certify(&texture);
    if let Some((worst, others)) = report.failures().split_first() {
        return Err(Error::Model(format!(
            "texture '{}' is not stable between its nodes in the {}: {worst}{}; fit it as a lattice (--structure \
             lattice), which is stable at every point",
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

/// The place of a cell and its nodes (index on the speed axis, on the force axis) in the kernel's order, none twice.
struct CellCorners {
    speeds_mm_s: [f32; 2],
    forces_n: [f32; 2],
    nodes: Vec<(usize, usize)>,
}

fn places(texture: &Texture<'_>, speeds_mm_s: &[f32], forces_n: &[f32]) -> Vec<CellCorners> {
    let (speed_cells, force_cells) = texture.cell_counts();
    let mut places = Vec::with_capacity(speed_cells * force_cells);
    for speed in 0..speed_cells {
        for force in 0..force_cells {
            let speeds = speed..=(speed + 1).min(speeds_mm_s.len() - 1);
            let forces = force..=(force + 1).min(forces_n.len() - 1);
            places.push(CellCorners {
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

fn lattice(texture: &Texture<'_>, places: &[CellCorners]) -> Vec<Finding> {
    let largest = |&(speed, force): &(usize, usize)| {
        let thetas = texture.node(speed, force).coefficients.thetas();
        thetas.map(i32::unsigned_abs).max().unwrap_or(0)
    };
    let finding = |place: &CellCorners| Finding::Lattice {
        largest_reflection: place
            .nodes
            .iter()
            .map(largest)
            .max()
            .map_or(0.0, |theta| (f64::from(theta) * FINE_THETA_STEP_RAD).sin()),
    };
    places.iter().map(finding).collect()
}

fn direct_form(texture: &Texture<'_>, places: &[CellCorners]) -> Vec<Finding> {
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
    let finding = |place: &CellCorners| {
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
    polynomial.extend(predictor(coefficients).iter().map(|h| -h));
    polynomial.resize(order + 1, 0.0);
    polynomial
}
