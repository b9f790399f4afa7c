//! Models and libraries for the tests.

use std::f64::consts::PI;
use std::path::Path;

use model_format::{
    CodeSpec, Library, MillimetresPerSecond, Newton, NodeSpec, Texture, TextureSpec, encode,
};
use serde_json::Value;
use stylus_kernel::Motion;
use stylus_kernel::rotation::{Rotation, THETA_FRACTION_BITS};

/// A model of order 400 of `tests/fixtures`.
pub struct Model {
    pub name: String,
    /// Reflection coefficients, the first stage first.
    pub reflection: Vec<f64>,
    /// Predictor h₁ first; h = -a.
    pub predictor: Vec<f64>,
    /// Power of the prediction error for an output power of 1.
    pub error: f64,
}

/// All six fixtures.
pub fn fixtures() -> Vec<Model> {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/levinson-order-400.json");
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let file: Value = serde_json::from_str(&text).expect("JSON");
    let numbers = |value: &Value| -> Vec<f64> {
        let values = value.as_array().expect("a list");
        values
            .iter()
            .map(|value| value.as_f64().expect("a number"))
            .collect()
    };
    let cases = file["cases"].as_array().expect("a list of cases");
    let models: Vec<Model> = cases
        .iter()
        .map(|case| Model {
            name: case["name"].as_str().expect("a name").to_owned(),
            reflection: numbers(&case["k"]),
            predictor: numbers(&case["a"])[1..].iter().map(|a| -a).collect(),
            error: case["error_over_r0"].as_f64().expect("a number"),
        })
        .collect();
    assert_eq!(models.len(), 6);
    models
}

/// The fixture of this name.
pub fn fixture(name: &str) -> Model {
    let found = fixtures().into_iter().find(|model| model.name == name);
    found.expect("a fixture of this name")
}

impl Model {
    /// θ codes of the lattice, rounded to the nearest step of π/65 536.
    pub fn theta_codes(&self) -> Vec<i16> {
        let code = |k: &f64| (k.asin() / PI * 65_536.0).round() as i16;
        self.reflection.iter().map(code).collect()
    }

    /// Rotations of the lattice, as the kernel plays the model's node.
    pub fn rotations(&self) -> Vec<Rotation> {
        self.theta_codes().into_iter().map(rotation).collect()
    }

    /// A node with this output power, (m/s²)².
    pub fn node(&self, output_power: f32) -> NodeSpec {
        NodeSpec {
            prediction_error_power: (f64::from(output_power) * self.error) as f32,
            ..NodeSpec::new(output_power, CodeSpec::lattice(self.theta_codes()))
        }
    }
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
    let library = Library::decode(bytes).expect("a valid library");
    library.textures().next().expect("a texture")
}

/// A finite motion.
pub fn motion(speed_mm_s: f32, force_n: f32) -> Motion {
    Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).expect("finite")
}

/// 2³¹, the scale of a rotation.
const ROTATION_UNIT: f64 = (1u64 << 31) as f64;

/// A normalised lattice in float64.
pub struct FloatLattice {
    /// (cos, sin) of each stage.
    rotations: Vec<(f64, f64)>,
    backward: Vec<f64>,
}

impl FloatLattice {
    /// A lattice at rest with the rotations that the kernel uses, exactly.
    pub fn new(rotations: &[Rotation]) -> Self {
        let float = |rotation: &Rotation| {
            (
                f64::from(rotation.cos) / ROTATION_UNIT,
                f64::from(rotation.sin) / ROTATION_UNIT,
            )
        };
        Self {
            rotations: rotations.iter().map(float).collect(),
            backward: vec![0.0; rotations.len() + 1],
        }
    }

    /// Replaces the backward signals by `backward`, `g[0]` first.
    pub fn begin(&mut self, backward: &[i32]) {
        for (own, &given) in self.backward.iter_mut().zip(backward) {
            *own = f64::from(given);
        }
    }

    pub fn filter(&mut self, excitation: f64) -> f64 {
        let mut f = excitation;
        for (stage, &(cos, sin)) in self.rotations.iter().enumerate().rev() {
            let g = self.backward[stage];
            self.backward[stage + 1] = sin * f + cos * g;
            f = cos * f - sin * g;
        }
        self.backward[0] = f;
        f
    }
}

/// Accumulates how far a signal is from its reference.
#[derive(Default)]
pub struct Deviation {
    signal: f64,
    error: f64,
}

impl Deviation {
    pub fn add(&mut self, reference: f64, actual: f64) {
        self.signal += reference * reference;
        self.error += (actual - reference).powi(2);
    }

    /// Signal to noise ratio, dB.
    pub fn snr_db(&self) -> f64 {
        10.0 * (self.signal / self.error).log10()
    }
}
