//! Stability of a texture at every point of its grid: what is proved of each cell, and what is sampled besides.
//!
//! **Normalised lattice, proved.** Every stored |θ| is below π/2 (the decoder refuses the code of π/2), and a weighted
//! mean of such θ is too, so every rotation that can be asked for is one of those between ∓π/2. The kernel's rotations
//! do not lengthen a vector, in the integers themselves, for any θ (a test of the kernel's goes through all 2²⁴ of
//! them), so the state's norm cannot grow, under any motion. Powers are within the library's bound, so that nothing
//! saturates that the level could prevent.
//!
//! **Direct form, proved.** By [`stylus_kernel::proof`], in integers: the same function by which a stylus proves a
//! library before it plays it. A margin that is found here is verified there with no more effort, so that a library
//! with these margins is not refused. The nodes are the stored coefficients, exactly; there is room for the kernel's
//! rounding of means, half a step per tap.
//!
//! A second proof, of another kind and in float64, is in the tests: `edges` shows by discs of frequency that no edge of
//! a cell has a zero on the circle (the edge theorem of Bartlett, Hollot and Lin, 1988).
//!
//! **Direct form, sampled.** [`SAMPLES_PER_SIDE`] + 1 by as many points of the cell, at weights that the kernel can
//! have, by another way: the step-down recursion in float64. It tells the largest pole radius among these points. A
//! texture is certified only if both agree.
//!
//! **Direct form, not shown.** All this is about a filter whose coefficients rest. While they change, a direct form's
//! state can grow though all its points are stable; and rounding and saturation can keep an oscillation alive. `stylus
//! stress` shows both.

#[cfg(test)]
mod circle;
#[cfg(test)]
mod edges;
mod finding;
mod interior;

use model_format::{
    Certificate, Coefficients, DecodeError, FINE_THETA_STEP_RAD, Library, Structure, Texture,
    TextureSpec, UNCERTIFIED_CELL, encode_uncertified,
};
use rayon::prelude::*;
use stylus_kernel::direct::exponent;
use stylus_kernel::proof::{CellProof, Proof, UNIT_BITS, margin_byte};

use crate::support::error::{Error, Result};
use crate::texture::stored::predictor;

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

/// Proves the direct forms of `library` as a stylus does before it plays them, with the margins that it claims.
///
/// # Errors
/// A stylus would refuse the library; the message names the texture and the cell.
pub fn prove_as_device(library: &Library<'_>) -> Result<()> {
    let mut proof = Proof::new(*library);
    let refusal = loop {
        match proof.step() {
            Ok(true) => {}
            Ok(false) => return Ok(()),
            Err(refusal) => break refusal,
        }
    };
    let texture = library.textures().nth(refusal.texture);
    let texture = texture.expect("the proof names one of its textures");
    Err(Error::Model(format!(
        "a stylus would refuse the library, because texture '{}' is {} in the cell from {} mm/s and {} N up, near {} \
         Hz; fit it again, as a lattice if it is no better then",
        texture.name(),
        refusal.cause,
        texture.speed(refusal.speed).0,
        texture.force(refusal.force).0,
        refusal.frequency_hz(texture.sample_rate_hz()),
    )))
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
    let exponent = exponent(texture);
    let unit = 2f64.powi(exponent as i32 - UNIT_BITS as i32);
    let forces = texture.force_axis().len();
    let rate_hz = f64::from(texture.sample_rate_hz());
    let finding = |place: &CellCorners| {
        let indices = || {
            place
                .nodes
                .iter()
                .map(|(speed, force)| speed * forces + force)
        };
        let &(speed, force) = place.nodes.first().expect("a cell has nodes");
        let proof = CellProof::new(*texture, speed, force).run();
        let corners: Vec<&[f64]> = indices()
            .map(|index| polynomials[index].as_slice())
            .collect();
        let worst = interior::worst(&corners, place.speeds_mm_s, place.forces_n);
        Finding::Direct {
            proved_margin: proof.ok().map(|units| units as f64 * unit),
            critical_frequency_hz: proof
                .err()
                .map(|refusal| f64::from(refusal.frequency) * 2f64.powi(-32) * rate_hz),
            stored_margin: proof.map_or(UNCERTIFIED_CELL, |units| margin_byte(units, exponent)),
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

#[cfg(test)]
mod tests {
    use super::circle::Circle;
    use super::*;
    use crate::dsp::linear_prediction::step_up;
    use model_format::{CodeSpec, Laws, NodeFlags, NodeSpec, Provenance, SAMPLE_RATE_HZ};
    use proptest::prelude::*;
    use stylus_kernel::proof::Cause;

    fn node(tail: &[f64]) -> NodeSpec {
        let sum: f64 = tail.iter().map(|a| a.abs()).sum();
        let exponent = (sum.log2().floor() + 1.0).max(0.0) as u8;
        let code = |a: &f64| (-a * 2f64.powi(31 - i32::from(exponent))).round() as i32;
        NodeSpec {
            output_power: 1.0,
            prediction_error_power: 0.5,
            flags: NodeFlags::NONE,
            codes: CodeSpec::Direct32 {
                exponent,
                codes: tail.iter().map(code).collect(),
            },
        }
    }

    /// A cell of four nodes.
    fn cell(tails: &[Vec<f64>]) -> Vec<u8> {
        let spec = TextureSpec {
            name: "cell".to_owned(),
            sample_rate_hz: SAMPLE_RATE_HZ,
            structure: Structure::DirectForm32,
            provenance: Provenance::Simulated,
            laws: Laws::default(),
            parts: model_format::PartsSpec::default(),
            speed_axis_mm_s: vec![1.0, 2.0],
            force_axis_n: vec![1.0, 2.0],
            nodes: tails.iter().map(|tail| node(tail)).collect(),
            cell_margins: Vec::new(),
        };
        encode_uncertified(&[spec]).unwrap()
    }

    proptest! {
        /// The product's proof and the one in float64 agree, where the margin leaves either room.
        #[test]
        fn two_proofs_of_different_kind_agree(
            near in prop::collection::vec(-0.95f64..0.95, 0..7),
            off in prop::collection::vec(prop::collection::vec(-0.6f64..0.6, 7), 4),
            spread in 0.0f64..1.0,
        ) {
            let corner = |off: &Vec<f64>| {
                let k = near.iter().zip(off).map(|(k, off)| (k + spread * off).clamp(-0.98, 0.98));
                step_up(&k.collect::<Vec<_>>())
            };
            let tails: Vec<Vec<f64>> = off.iter().map(corner).collect();
            let bytes = cell(&tails);
            let library = Library::decode_uncertified(&bytes).unwrap();
            let texture = library.textures().next().unwrap();
            let order = texture.max_order();
            let exponent = exponent(&texture) as i32;
            let rounding = order as f64 * 2f64.powi(exponent - 32);
            let circles: Vec<Circle> = texture
                .nodes()
                .map(|node| Circle::new(&polynomial(node.coefficients, order)))
                .collect();
            let other = edges::prove(&circles.iter().collect::<Vec<_>>(), rounding);
            let unit = 2f64.powi(exponent - UNIT_BITS as i32);
            let found = CellProof::new(texture, 0, 0).run().map(|units| units as f64 * unit);
            // Each is at least 0.4 of the exact minimum, less twice what evaluation and the kernel's rounding may be
            // off by, below 50 000 units, and what the 17 digits of a direction cost; and at most that minimum.
            let sum = |tail: &Vec<f64>| 1.0 + tail.iter().map(|a| a.abs()).sum::<f64>();
            let largest = tails.iter().map(sum).fold(0.0, f64::max);
            let room = 2.5 * (2.0 * 50_000.0 * unit + largest * 2f64.powi(-17)) + 1e-6;
            let none = 2.0 * room + 1e-5;
            match (found, other) {
                (Ok(found), Ok(other)) => {
                    prop_assert!(found <= 2.6 * other + room && other <= 2.6 * found + room, "{} {}", found, other);
                }
                (Ok(found), Err(at)) => prop_assert!(found < none, "{} but not at {} rad", found, at),
                // Effort has a bound, which one in a hundred thousand of these cells with a small margin exceeds.
                (Err(refusal), Ok(other)) if refusal.cause == Cause::Effort => {
                    prop_assert!(other < 1e-3 * largest, "{:?} but {}", refusal, other);
                }
                (Err(refusal), Ok(other)) => prop_assert!(other < none, "{:?} but {}", refusal, other),
                (Err(_), Err(_)) => {}
            }
        }
    }

    #[test]
    fn a_library_with_the_margins_found_is_not_refused_by_a_device() {
        let tails: Vec<Vec<f64>> = (0..4)
            .map(|corner| step_up(&[-0.97 + 0.01 * f64::from(corner), 0.9, 0.2]))
            .collect();
        let bytes = cell(&tails);
        let library = Library::decode_uncertified(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let report = certify(&texture);
        assert!(report.holds);
        let spec = TextureSpec {
            name: "cell".to_owned(),
            sample_rate_hz: SAMPLE_RATE_HZ,
            structure: texture.structure(),
            provenance: Provenance::Simulated,
            laws: Laws::default(),
            parts: model_format::PartsSpec::default(),
            speed_axis_mm_s: vec![1.0, 2.0],
            force_axis_n: vec![1.0, 2.0],
            nodes: tails.iter().map(|tail| node(tail)).collect(),
            cell_margins: report.cell_margins(),
        };
        let certified = model_format::encode(std::slice::from_ref(&spec)).unwrap();
        prove_as_device(&Library::decode(&certified).unwrap()).unwrap();
        let claims_too_much = TextureSpec {
            cell_margins: vec![0; 1],
            ..spec
        };
        let forged = model_format::encode(&[claims_too_much]).unwrap();
        let refusal = prove_as_device(&Library::decode(&forged).unwrap()).unwrap_err();
        assert!(refusal.to_string().contains("'cell'"), "{refusal}");
    }
}
