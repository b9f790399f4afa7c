//! Models and libraries for the tests.

use std::f64::consts::PI;

use model_format::{CodeSpec, Library, MillimetresPerSecond, Newton, NodeSpec, Texture, TextureSpec, encode};
use stylus_hard_cases::NamedModel;
use stylus_kernel::Motion;
use stylus_kernel::rotation::{Rotation, THETA_FRACTION_BITS};

/// A hard model of order 400.
pub struct Model {
    pub name: String,
    /// Reflection coefficients, the first stage first.
    reflection: Vec<f64>,
    /// Predictor h₁ first; h = -a.
    pub predictor: Vec<f64>,
    /// Power of the prediction error for an output power of 1.
    pub error: f64,
}

/// All six hard models.
pub fn fixtures() -> Vec<Model> {
    let of = |model: NamedModel| Model {
        predictor: model.predictor(),
        error: model.error_share(),
        name: model.name,
        reflection: model.reflection,
    };
    stylus_hard_cases::fixtures().into_iter().map(of).collect()
}

/// The fixture of this name.
pub fn fixture(name: &str) -> Model {
    fixtures()
        .into_iter()
        .find(|model| model.name == name)
        .expect("a fixture of this name")
}

impl Model {
    /// Rotations of the lattice, as the kernel plays the model's node.
    pub fn rotations(&self) -> Vec<Rotation> {
        theta_codes(&self.reflection).into_iter().map(rotation).collect()
    }

    /// A node with this output power, (m/s²)².
    pub fn node(&self, output_power: f32) -> NodeSpec {
        NodeSpec {
            prediction_error_power: (f64::from(output_power) * self.error) as f32,
            ..NodeSpec::new(output_power, CodeSpec::lattice(theta_codes(&self.reflection)))
        }
    }
}

/// θ codes of a lattice with these reflection coefficients, rounded to the nearest step of π/65 536.
fn theta_codes(reflection: &[f64]) -> Vec<i16> {
    let code = |k: &f64| (k.asin() / PI * 65_536.0).round() as i16;
    reflection.iter().map(code).collect()
}

/// A node with these reflection coefficients and an RMS of 1 m/s².
pub fn lattice(reflection: &[f64]) -> NodeSpec {
    NodeSpec::new(1.0, CodeSpec::lattice(theta_codes(reflection)))
}

/// The rotation of a stored θ code, as the kernel plays it at its own node.
pub fn rotation(code: i16) -> Rotation {
    Rotation::from_theta(i32::from(code) << THETA_FRACTION_BITS)
}

/// A library of one texture on the grid `speeds` × `forces`, its nodes speed-major.
pub fn library(speeds: &[f32], forces: &[f32], nodes: Vec<NodeSpec>) -> Vec<u8> {
    encode(&[spec(speeds, forces, nodes)]).expect("a valid library")
}

/// The texture of [`library`], before it is encoded.
pub fn spec(speeds: &[f32], forces: &[f32], nodes: Vec<NodeSpec>) -> TextureSpec {
    TextureSpec::new("test", speeds, forces, nodes)
}

/// A library of one texture of one node, at 100 mm/s and 1 N.
pub fn single(node: NodeSpec) -> Vec<u8> {
    library(&[100.0], &[1.0], vec![node])
}

/// The only texture of a library.
pub fn texture(bytes: &[u8]) -> Texture<'_> {
    Library::decode(bytes)
        .expect("a valid library")
        .textures()
        .next()
        .expect("a texture")
}

/// A finite motion.
pub fn motion(speed_mm_s: f32, force_n: f32) -> Motion {
    Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).expect("finite")
}
