//! Models and libraries for the tests.

use std::f64::consts::PI;
use std::path::Path;

use model_format::{
    CodeSpec, Laws, Library, MillimetresPerSecond, Newton, NodeFlags, NodeSpec, PartsSpec,
    Provenance, SAMPLE_RATE_HZ, Structure, Texture, TextureSpec, encode,
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
    /// θ codes of the lattice, to the nearest step of π/65 536.
    pub fn theta_codes(&self) -> Vec<i16> {
        let code = |k: &f64| (k.asin() / PI * 65_536.0).round() as i16;
        self.reflection.iter().map(code).collect()
    }

    /// Rotations of the lattice, as the kernel plays the model's node.
    pub fn rotations(&self) -> Vec<Rotation> {
        self.theta_codes().into_iter().map(rotation).collect()
    }

    /// A node of `structure` with this output power, (m/s²)².
    pub fn node(&self, structure: Structure, output_power: f32) -> NodeSpec {
        let exponent = self.exponent(structure);
        let code = |h: &f64, bits: i32| (h * 2f64.powi(bits - i32::from(exponent))).round();
        let h = self.predictor.iter();
        NodeSpec {
            output_power,
            prediction_error_power: (f64::from(output_power) * self.error) as f32,
            flags: NodeFlags::NONE,
            codes: match structure {
                Structure::NormalisedLattice => CodeSpec::lattice(self.theta_codes()),
                Structure::DirectForm16 => CodeSpec::Direct16 {
                    exponent,
                    codes: h.map(|h| code(h, 15) as i16).collect(),
                },
                Structure::DirectForm32 => CodeSpec::Direct32 {
                    exponent,
                    codes: h.map(|h| code(h, 31) as i32).collect(),
                },
            },
        }
    }

    /// The lowest exponent at which no code and no sum of codes overflows.
    fn exponent(&self, structure: Structure) -> u8 {
        let bound = match structure {
            Structure::NormalisedLattice => return 0,
            Structure::DirectForm16 => self
                .predictor
                .iter()
                .fold(0.0, |high: f64, h| high.max(h.abs())),
            Structure::DirectForm32 => self.predictor.iter().map(|h| h.abs()).sum(),
        };
        (bound.log2().floor() + 1.0).max(0.0) as u8
    }
}

/// The rotation of a stored θ code, as it is played on its own node.
pub fn rotation(code: i16) -> Rotation {
    Rotation::from_theta(i32::from(code) << THETA_FRACTION_BITS)
}

/// A library of one texture on the grid `speeds` × `forces`, its nodes speed-major.
pub fn library(
    structure: Structure,
    speeds: &[f32],
    forces: &[f32],
    nodes: Vec<NodeSpec>,
) -> Vec<u8> {
    encode(&[spec(structure, speeds, forces, nodes)]).expect("a valid library")
}

/// The texture of [`library`], as it is written.
pub fn spec(
    structure: Structure,
    speeds: &[f32],
    forces: &[f32],
    nodes: Vec<NodeSpec>,
) -> TextureSpec {
    TextureSpec {
        name: "test".to_owned(),
        sample_rate_hz: SAMPLE_RATE_HZ,
        structure,
        provenance: Provenance::Simulated,
        laws: Laws::default(),
        parts: PartsSpec::default(),
        speed_axis_mm_s: speeds.to_vec(),
        force_axis_n: forces.to_vec(),
        nodes,
    }
}

/// A library of one texture of one node, at 100 mm/s and 1 N.
pub fn single(structure: Structure, node: NodeSpec) -> Vec<u8> {
    library(structure, &[100.0], &[1.0], vec![node])
}

/// The only texture of a library.
pub fn texture(bytes: &[u8]) -> Texture<'_> {
    let library = Library::decode(bytes).expect("a valid library");
    library.textures().next().expect("a texture")
}

/// A node that puts out nothing.
pub fn silent_node(structure: Structure) -> NodeSpec {
    let codes = Vec::new();
    NodeSpec {
        output_power: 0.0,
        prediction_error_power: 0.0,
        flags: NodeFlags::SILENT,
        codes: match structure {
            Structure::NormalisedLattice => CodeSpec::lattice(codes),
            Structure::DirectForm16 => CodeSpec::Direct16 { exponent: 0, codes },
            Structure::DirectForm32 => CodeSpec::Direct32 {
                exponent: 0,
                codes: Vec::new(),
            },
        },
    }
}

/// All structures.
pub const STRUCTURES: [Structure; 3] = [
    Structure::NormalisedLattice,
    Structure::DirectForm16,
    Structure::DirectForm32,
];

/// A finite motion.
pub fn motion(speed_mm_s: f32, force_n: f32) -> Motion {
    Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).expect("finite")
}
