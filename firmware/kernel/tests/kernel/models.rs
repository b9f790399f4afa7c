//! Models, libraries, scenes and interactions for the tests.

use std::f64::consts::PI;

use model_format::scene::{Biquad, Region, Scene, SceneName, Surface, Tap};
use model_format::{
    CodeSpec, Library, MillimetresPerSecond, Newton, NodeSpec, SAMPLE_RATE_HZ, Texture, TextureSpec, encode,
    encode_with_scenes,
};
use stylus_hard_cases::{NamedModel, resonance};
use stylus_kernel::rotation::{Rotation, THETA_FRACTION_BITS};
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer};
use stylus_kernel::{Motion, UPDATE_INTERVAL_SAMPLES};

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

/// A texture of `node` at 50 and 100 mm/s, 0.5 and 1 N.
pub fn texture_of(name: &str, node: &NodeSpec) -> TextureSpec {
    TextureSpec::new(name, &[50.0, 100.0], &[0.5, 1.0], vec![node.clone(); 4])
}

/// A lattice of two stages that resonates at `hz`, with an RMS of 1 m/s².
pub fn resonant(name: &str, hz: f64) -> TextureSpec {
    let node = lattice(&resonance(0.98, hz).reflection);
    texture_of(name, &node)
}

/// Two smooth textures, at 60 and 110 Hz, and two of order 400.
pub fn textures() -> Vec<TextureSpec> {
    let long = |name| texture_of(name, &fixture(name).node(4.0));
    [resonant("slow", 60.0), resonant("quick", 110.0)]
        .into_iter()
        .chain(["H3", "H1b"].map(long))
        .collect()
}

/// A library of [`textures`] and `scenes`.
pub fn scene_library(scenes: &[Scene]) -> Vec<u8> {
    encode_with_scenes(&textures(), scenes).expect("valid scenes")
}

pub fn plan<'a>(bytes: &'a [u8], scene: &Scene) -> Plan<'a> {
    let library = Library::decode(bytes).expect("a valid library");
    Plan::new(scene, &library).expect("a valid scene")
}

pub fn player<'a>(bytes: &'a [u8], scene: &Scene, seed: u64) -> ScenePlayer<'a> {
    ScenePlayer::new(plan(bytes, scene), seed)
}

pub fn name(text: &str) -> SceneName {
    SceneName::try_from(text).expect("a short name")
}

/// A scene of these textures, each in a region of 100 mm, from 0 mm on.
pub fn side_by_side(textures: &[u8], transition_mm: f32) -> Scene {
    let mut scene = Scene::of_surface(name("test"), SAMPLE_RATE_HZ, Surface::of_texture(textures[0]));
    scene.surfaces.clear();
    scene.transition_mm = transition_mm;
    for (index, &texture) in textures.iter().enumerate() {
        let surface = Surface::of_texture(texture);
        scene.surfaces.push(surface).expect("few surfaces");
        let ends_mm = [index, index + 1].map(|end| 100.0 * end as f32);
        add_region(&mut scene, ends_mm, index as u8);
    }
    scene
}

pub fn add_region(scene: &mut Scene, [start_mm, end_mm]: [f32; 2], surface: u8) {
    let region = Region {
        start_mm,
        end_mm,
        surface,
    };
    scene.regions.push(region).expect("few regions");
}

pub fn tap(frequency_hz: f32, decay_s: f32) -> Tap {
    Tap {
        frequency_hz,
        decay_s,
        gain_m_s2_per_n_s: 0.1,
        limit_m_s2: 20.0,
    }
}

/// A section with poles at `radius` and ± `hz`, and gain 1 at 0 Hz and 2500 Hz. The zeros have `zero_radius` and the
/// same frequency.
pub fn biquad(hz: f64, radius: f64, zero_radius: f64) -> Biquad {
    let cos = (2.0 * std::f64::consts::PI * hz / f64::from(SAMPLE_RATE_HZ)).cos();
    let polynomial = |r: f64| [1.0, -2.0 * r * cos, r * r];
    let [_, a1, a2] = polynomial(radius);
    Biquad::from_f64(polynomial(zero_radius), [a1, a2]).expect("within range")
}

pub fn at(position_mm: f32, motion: Motion) -> Interaction {
    Interaction::new(motion, position_mm, true).expect("finite")
}

pub fn lifted() -> Interaction {
    Interaction::NONE
}

/// A motion on the grid of [`textures`].
pub fn moving() -> Motion {
    motion(75.0, 0.75)
}

/// Plays a block and returns its samples, m/s².
pub fn block(player: &mut ScenePlayer<'_>, interaction: Interaction) -> Vec<f64> {
    player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
    (0..UPDATE_INTERVAL_SAMPLES)
        .map(|_| f64::from(player.next_sample().metres_per_second_squared().0))
        .collect()
}

pub fn largest_step(samples: &[f64]) -> f64 {
    samples
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .fold(0.0, f64::max)
}

pub fn peak(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |peak: f64, sample| peak.max(sample.abs()))
}
