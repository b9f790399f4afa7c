//! Writing a library, which only hosts do.

use alloc::vec::Vec;

use crate::error::{DecodeError, Place, Problem};
use crate::library::part::{self, excitation, fine_theta, levels, lines, tails, wander};
use crate::library::{Coefficients, Laws, Library, NodeFlags, PartsSpec, TailSpec, theta};
use crate::limits;
use crate::scene::Scene;
use crate::scene::limits::MAX_SCENES;
use crate::wire::{self, NodeRecord, Prefix, Provenance, Summary, TextureRecord};

/// A texture to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSpec {
    /// Name, unique in its library.
    pub name: alloc::string::String,
    /// Sample rate of the models, Hz.
    pub sample_rate_hz: u32,
    /// Origin of the recordings.
    pub provenance: Provenance,
    /// Laws of the level between nodes and below the grid.
    pub laws: Laws,
    /// Optional parts.
    pub parts: PartsSpec,
    /// Tangential speeds of the grid, mm/s, ascending.
    pub speed_axis_mm_s: Vec<f32>,
    /// Normal forces of the grid, N, ascending.
    pub force_axis_n: Vec<f32>,
    /// Models of all nodes, speed-major: all forces of the first speed come first.
    pub nodes: Vec<NodeSpec>,
}

/// A model to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeSpec {
    /// Variance of the model's output, (m/s²)².
    pub output_power: f32,
    /// Variance of the prediction error of the model that was fitted, (m/s²)². It is only for reports.
    pub prediction_error_power: f32,
    /// Flags of the node: its origin, and whether it is silent or doubtful.
    pub flags: NodeFlags,
    /// Coefficients, as many as the model's order.
    pub codes: CodeSpec,
}

/// Coefficients to be written: θ of stage 1 first. [`CodeSpec::lattice`], [`CodeSpec::fine_lattice`] and
/// [`CodeSpec::compact_lattice`] create them.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeSpec {
    /// The codes, in steps of [`crate::THETA_STEP_RAD`].
    pub codes: Vec<i16>,
    /// Fractions of θ of the first stages, in steps of [`crate::FINE_THETA_STEP_RAD`]; further stages have a fraction
    /// of 0. Only the first [`limits::MAX_FINE_STAGES`] may have a fraction that is not 0.
    pub fractions: Vec<i8>,
    /// The stages after those of `codes`. If one node of a texture has a tail, then every node with more than
    /// [`limits::MAX_FINE_STAGES`] stages must have one, which begins after that number of stages.
    pub tail: TailSpec,
}

impl TextureSpec {
    /// Creates a simulated texture of `nodes` at [`crate::SAMPLE_RATE_HZ`], with the default laws and without optional
    /// parts. `speeds` are in mm/s and `forces` in N.
    pub fn new(name: &str, speeds: &[f32], forces: &[f32], nodes: Vec<NodeSpec>) -> Self {
        Self {
            name: name.into(),
            sample_rate_hz: crate::SAMPLE_RATE_HZ,
            provenance: Provenance::Simulated,
            laws: Laws::default(),
            parts: PartsSpec::default(),
            speed_axis_mm_s: speeds.to_vec(),
            force_axis_n: forces.to_vec(),
            nodes,
        }
    }
}

impl NodeSpec {
    /// Creates a node with this output power, (m/s²)². It is silent at a power of 0 and has no other flag. Its
    /// prediction error gets the same power as its output.
    pub fn new(output_power: f32, codes: CodeSpec) -> Self {
        Self {
            output_power,
            prediction_error_power: output_power,
            flags: if output_power > 0.0 {
                NodeFlags::NONE
            } else {
                NodeFlags::SILENT
            },
            codes,
        }
    }

    /// Creates a silent node, without coefficients.
    pub fn silent() -> Self {
        Self::new(0.0, CodeSpec::lattice(Vec::new()))
    }
}

impl From<Coefficients<'_>> for CodeSpec {
    /// Copies the coefficients of a decoded node. Encoding them gives the same bytes.
    fn from(stored: Coefficients<'_>) -> Self {
        let signed = |bytes: &[u8]| bytes.iter().map(|byte| byte.cast_signed()).collect();
        let codes = stored.codes.iter();
        Self {
            codes: codes.map(|&code| i16::from_le_bytes(code)).collect(),
            fractions: signed(stored.fractions),
            tail: TailSpec {
                codes: signed(stored.tail.codes),
                step: stored.tail.step,
            },
        }
    }
}

impl CodeSpec {
    /// Creates a lattice of these codes, without fractions.
    pub const fn lattice(codes: Vec<i16>) -> Self {
        Self {
            codes,
            fractions: Vec::new(),
            tail: TailSpec::NONE,
        }
    }

    /// Creates a lattice from θ in steps of [`crate::FINE_THETA_STEP_RAD`], stage 1 first. The first
    /// [`limits::MAX_FINE_STAGES`] stages keep all digits of θ. In further stages, θ is rounded to the nearest 16-bit
    /// code.
    ///
    /// A θ whose magnitude exceeds [`crate::MAX_FINE_THETA`] is limited to it.
    pub fn fine_lattice(thetas: &[i32]) -> Self {
        let split = |&theta: &i32| {
            let theta = theta.clamp(-crate::MAX_FINE_THETA, crate::MAX_FINE_THETA);
            // Rounded to nearest, so that the fraction fits in a signed byte.
            let code = (theta + (1 << (crate::THETA_FRACTION_BITS - 1))) >> crate::THETA_FRACTION_BITS;
            (code as i16, (theta - (code << crate::THETA_FRACTION_BITS)) as i8)
        };
        let fine = thetas.iter().take(limits::MAX_FINE_STAGES);
        Self {
            codes: thetas.iter().map(|theta| split(theta).0).collect(),
            fractions: fine.map(|theta| split(theta).1).collect(),
            tail: TailSpec::NONE,
        }
    }

    /// Creates a lattice from θ in steps of [`crate::FINE_THETA_STEP_RAD`], stage 1 first, that takes the fewest bytes.
    /// The first `fine` stages keep all digits of θ. In further stages, θ is rounded to the nearest 16-bit code. The
    /// stages after the first [`limits::MAX_FINE_STAGES`] form a tail, see [`TailSpec::of`].
    pub fn compact_lattice(thetas: &[i32], fine: usize) -> Self {
        let (before, after) = thetas.split_at(thetas.len().min(limits::MAX_FINE_STAGES));
        let mut node = Self::fine_lattice(before);
        node.fractions.truncate(fine);
        node.tail = TailSpec::of(after);
        node
    }

    /// θ of all stages, stage 1 first, in steps of [`crate::FINE_THETA_STEP_RAD`].
    pub fn thetas(&self) -> impl Iterator<Item = i32> + '_ {
        let fractions = self.fractions.iter().copied();
        let both = self.codes.iter().zip(fractions.chain(core::iter::repeat(0)));
        both.map(|(&code, fraction)| theta(code, fraction))
            .chain(self.tail.thetas())
    }

    fn order(&self) -> usize {
        self.codes.len() + self.tail.codes.len()
    }

    fn append_to(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.codes.iter().flat_map(|code| code.to_le_bytes()));
        bytes.extend(self.tail.codes.iter().map(|code| code.cast_unsigned()));
    }
}

/// Encodes a library of `textures`.
///
/// The bytes returned have passed [`Library::decode`].
///
/// # Errors
/// A fault that bytes cannot express, such as a tail at the wrong stage, or else the first one that decoding reports.
pub fn encode(textures: &[TextureSpec]) -> Result<Vec<u8>, DecodeError> {
    encode_with_scenes(textures, &[])
}

/// Encodes a library of `textures` and of `scenes`, which refer to textures by their index.
///
/// The bytes returned have passed [`Library::decode`].
///
/// ```
/// # use model_format::{CodeSpec, NodeSpec, SAMPLE_RATE_HZ, TextureSpec};
/// use model_format::scene::{Region, Scene, SceneProblem, Surface};
/// use model_format::{Library, Problem, encode_with_scenes};
/// # let node = NodeSpec::new(4.0, CodeSpec::lattice(vec![-20_000]));
/// # let textures = [TextureSpec::new("denim", &[100.0], &[1.0], vec![node])];
///
/// let name = "strip".try_into().expect("at most 48 bytes");
/// let mut strip = Scene::of_surface(name, SAMPLE_RATE_HZ, Surface::of_texture(0));
/// let region = Region { start_mm: 0.0, end_mm: 40.0, surface: 0 };
/// strip.regions.push(region).expect("at most 32 regions");
/// let bytes = encode_with_scenes(&textures, &[strip.clone()])?;
/// assert_eq!(Library::decode(&bytes)?.scene("strip"), Some(strip.clone()));
///
/// strip.surfaces[0].texture = Some(1);
/// let error = encode_with_scenes(&textures, &[strip]).unwrap_err();
/// let unknown = SceneProblem::UnknownTexture { texture: 1, count: 1 };
/// assert!(matches!(error.problem, Problem::Scene(fault) if fault.problem == unknown));
/// assert_eq!(error.to_string(), "scene 0: surface 0: texture 1 is not there: the library has 1");
/// # Ok::<(), model_format::DecodeError>(())
/// ```
///
/// # Errors
/// A fault that bytes cannot express, such as a tail at the wrong stage, or else the first one that decoding reports.
pub fn encode_with_scenes(textures: &[TextureSpec], scenes: &[Scene]) -> Result<Vec<u8>, DecodeError> {
    // Decoding finds every fault that bytes can hold. Only what they cannot hold is refused while they are written.
    let bytes = bytes_of(textures, scenes)?;
    Library::decode(&bytes)?;
    Ok(bytes)
}

fn bytes_of(textures: &[TextureSpec], scenes: &[Scene]) -> Result<Vec<u8>, DecodeError> {
    let count = textures.len();
    Problem::count("the number of textures", count, [1, limits::MAX_TEXTURES])
        .map_err(|problem| problem.at(Place::Library))?;
    let mut bytes = alloc::vec![0; wire::PREFIX_BYTES];
    let malformed = |_| Problem::Malformed("its header").at(Place::Library);
    bytes.extend(postcard::to_allocvec(&(count as u32)).map_err(malformed)?);
    for (index, texture) in textures.iter().enumerate() {
        append_texture(texture, index, &mut bytes)?;
    }
    // Before the cast, in which 256 scenes would become none.
    Problem::count("the number of scenes", scenes.len(), [0, MAX_SCENES])
        .map_err(|problem| problem.at(Place::Library))?;
    bytes.push(scenes.len() as u8);
    for (index, scene) in scenes.iter().enumerate() {
        append_scene(scene, index, &mut bytes)?;
    }
    write_prefix(&mut bytes);
    Ok(bytes)
}

fn append_scene(scene: &Scene, index: usize, bytes: &mut Vec<u8>) -> Result<(), DecodeError> {
    let malformed = |_| Problem::Malformed("its record").at(Place::Scene(index));
    let record = postcard::to_allocvec(scene).map_err(malformed)?;
    bytes.extend(postcard::to_allocvec(record.as_slice()).map_err(malformed)?);
    Ok(())
}

fn append_texture(texture: &TextureSpec, index: usize, bytes: &mut Vec<u8>) -> Result<(), DecodeError> {
    let mut nodes = Vec::new();
    let mut coefficients = Vec::new();
    let mut summary = Summary::default();
    for (number, node) in texture.nodes.iter().enumerate() {
        let place = node_place(texture, index, number);
        let order = node.codes.order();
        // Before the cast, in which an order of 65 536 would become 0.
        Problem::count("the order", order, [0, limits::MAX_ORDER]).map_err(|problem| problem.at(place))?;
        let record = NodeRecord {
            order: order as u16,
            flags: u16::from(node.flags.bits()),
            output_power: node.output_power,
            prediction_error_power: node.prediction_error_power,
            offset: coefficients.len() as u32,
        };
        nodes.extend(record.bytes());
        summary = summary.with_node(record.order, record.output_power);
        node.codes.append_to(&mut coefficients);
    }
    let record = TextureRecord {
        name: &texture.name,
        sample_rate_hz: texture.sample_rate_hz,
        provenance: texture.provenance,
        speed_axis: &axis_bytes(&texture.speed_axis_mm_s),
        force_axis: &axis_bytes(&texture.force_axis_n),
        nodes: &nodes,
        coefficients: &coefficients,
        summary,
    };
    let malformed = |_| Problem::Malformed("its header").at(Place::Texture(index));
    let mut encoded = postcard::to_allocvec(&record).map_err(malformed)?;
    append_parts(texture, index, &mut encoded)?;
    bytes.extend(postcard::to_allocvec(encoded.as_slice()).map_err(malformed)?);
    Ok(())
}

fn append_parts(texture: &TextureSpec, index: usize, bytes: &mut Vec<u8>) -> Result<(), DecodeError> {
    let fractions: Vec<&[i8]> = texture
        .nodes
        .iter()
        .map(|node| node.codes.fractions.as_slice())
        .collect();
    let fine_theta =
        fine_theta::part(&fractions).map_err(|(number, problem)| problem.at(node_place(texture, index, number)))?;
    let tails = tails::part(
        texture
            .nodes
            .iter()
            .map(|node| (node.codes.codes.len(), &node.codes.tail)),
    )
    .map_err(|(number, problem)| problem.at(node_place(texture, index, number)))?;
    let lines = texture.parts.lines.as_ref();
    let lines = lines.map(|spec| lines::content(spec, texture.nodes.len()));
    let lines = lines
        .transpose()
        .map_err(|problem| problem.at(Place::Texture(index)))?
        .map(|content| (lines::KIND, content));
    let wander = texture.parts.lines.as_ref().and_then(lines::wander_content);
    let malformed = |_| Problem::Malformed("an optional part").at(Place::Texture(index));
    let excitation = texture.parts.excitation.as_ref().map(excitation::part);
    // By ascending kind, as every reader demands.
    let parts: Vec<_> = [
        levels::part(texture.laws),
        fine_theta,
        excitation.transpose().map_err(malformed)?,
        lines,
        tails,
        wander.map(|content| (wander::KIND, content)),
    ]
    .into_iter()
    .flatten()
    .collect();
    part::append(&parts, bytes).map_err(malformed)
}

/// Place of node `number`. The texture may be invalid and have no force axis.
fn node_place(texture: &TextureSpec, index: usize, number: usize) -> Place {
    let forces = texture.force_axis_n.len().max(1);
    Place::Node {
        texture: index,
        speed: number / forces,
        force: number % forces,
    }
}

fn axis_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Writes the prefix of a library whose body is complete.
fn write_prefix(bytes: &mut [u8]) {
    let mut prefix = Prefix {
        magic: wire::MAGIC,
        version: wire::FORMAT_VERSION,
        reserved: 0,
        total_bytes: bytes.len() as u32,
        crc32: 0,
    };
    for _ in 0..2 {
        // The first pass writes the fields that the checksum covers, the second pass writes the checksum.
        postcard::to_slice(&prefix, &mut bytes[..wire::PREFIX_BYTES])
            .expect("a prefix of fixed-width fields fits its fixed length");
        prefix.crc32 = wire::checksum(bytes);
    }
}
