//! Writing a library. Only hosts do.

use alloc::vec::Vec;

use crate::error::{DecodeError, Place, Problem};
use crate::library::{Library, NodeFlags};
use crate::limits;
use crate::scene::Scene;
use crate::scene::limits::MAX_SCENES;
use crate::wire::{
    self, CertificateRecord, NodeRecord, Prefix, Provenance, Structure, TextureRecord,
};

/// A texture to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSpec {
    /// Name, unique in its library.
    pub name: alloc::string::String,
    /// Samples a second at which the models hold.
    pub sample_rate_hz: u32,
    /// What the coefficients are for.
    pub structure: Structure,
    /// Where the recordings came from.
    pub provenance: Provenance,
    /// Tangential speeds, mm/s, ascending.
    pub speed_axis_mm_s: Vec<f32>,
    /// Normal forces, N, ascending.
    pub force_axis_n: Vec<f32>,
    /// Models, speed-major: all forces of the first speed come first.
    pub nodes: Vec<NodeSpec>,
    /// What is certified of a direct form's cells, see [`crate::Certificate::DirectForm`]; empty if nothing is. A lattice
    /// has none: what is certified of it follows from its codes.
    pub cell_margins: Vec<u8>,
}

/// A model to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeSpec {
    /// Variance of what the model puts out, (m/s²)².
    pub output_power: f32,
    /// Variance of the white excitation of a direct form, (m/s²)².
    pub prediction_error_power: f32,
    /// What is to be known about its origin.
    pub flags: NodeFlags,
    /// Coefficients, as many as the order.
    pub codes: CodeSpec,
}

/// Coefficients to be written, in the structure of their texture; see [`crate::Coefficients`] for their scales.
#[derive(Clone, Debug, PartialEq)]
pub enum CodeSpec {
    /// θ of stage 1 first.
    Lattice(Vec<i16>),
    /// h₁ first.
    Direct16 {
        /// Binary exponent of the whole node.
        exponent: u8,
        /// The codes.
        codes: Vec<i16>,
    },
    /// h₁ first.
    Direct32 {
        /// Binary exponent of the whole node.
        exponent: u8,
        /// The codes.
        codes: Vec<i32>,
    },
}

impl CodeSpec {
    fn structure(&self) -> Structure {
        match self {
            Self::Lattice(_) => Structure::NormalisedLattice,
            Self::Direct16 { .. } => Structure::DirectForm16,
            Self::Direct32 { .. } => Structure::DirectForm32,
        }
    }

    fn exponent(&self) -> u8 {
        match *self {
            Self::Lattice(_) => 0,
            Self::Direct16 { exponent, .. } | Self::Direct32 { exponent, .. } => exponent,
        }
    }

    fn order(&self) -> usize {
        match self {
            Self::Lattice(codes) | Self::Direct16 { codes, .. } => codes.len(),
            Self::Direct32 { codes, .. } => codes.len(),
        }
    }

    fn append_to(&self, bytes: &mut Vec<u8>) {
        match self {
            Self::Lattice(codes) | Self::Direct16 { codes, .. } => {
                bytes.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
            }
            Self::Direct32 { codes, .. } => {
                bytes.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
            }
        }
    }
}

/// The bytes of a library of `textures`.
///
/// What is returned has been through [`Library::decode`].
///
/// # Errors
/// Whatever makes the library invalid, as decoding it would tell.
pub fn encode(textures: &[TextureSpec]) -> Result<Vec<u8>, DecodeError> {
    encode_with_scenes(textures, &[])
}

/// The bytes of a library of `textures` and of `scenes` that refer to them.
///
/// What is returned has been through [`Library::decode`].
///
/// # Errors
/// Whatever makes the library invalid, as decoding it would tell.
pub fn encode_with_scenes(
    textures: &[TextureSpec],
    scenes: &[Scene],
) -> Result<Vec<u8>, DecodeError> {
    let bytes = bytes_of(textures, scenes)?;
    Library::decode(&bytes)?;
    Ok(bytes)
}

/// As [`encode`], but direct forms need no certificate; see [`Library::decode_uncertified`], which reads what it gives.
///
/// # Errors
/// Whatever makes the library invalid, as decoding it would tell.
pub fn encode_uncertified(textures: &[TextureSpec]) -> Result<Vec<u8>, DecodeError> {
    encode_with_scenes_uncertified(textures, &[])
}

/// As [`encode_with_scenes`], but direct forms need no certificate.
///
/// # Errors
/// Whatever makes the library invalid, as decoding it would tell.
pub fn encode_with_scenes_uncertified(
    textures: &[TextureSpec],
    scenes: &[Scene],
) -> Result<Vec<u8>, DecodeError> {
    let bytes = bytes_of(textures, scenes)?;
    Library::decode_uncertified(&bytes)?;
    Ok(bytes)
}

fn bytes_of(textures: &[TextureSpec], scenes: &[Scene]) -> Result<Vec<u8>, DecodeError> {
    let count = textures.len();
    if count > limits::MAX_TEXTURES {
        return Err(Problem::TextureCount(count).at(Place::Library));
    }
    let mut bytes = alloc::vec![0; wire::PREFIX_BYTES];
    bytes.push(count as u8);
    for (index, texture) in textures.iter().enumerate() {
        append_texture(texture, index, &mut bytes)?;
    }
    if scenes.len() > MAX_SCENES {
        return Err(Problem::SceneCount(scenes.len()).at(Place::Library));
    }
    bytes.push(scenes.len() as u8);
    for (index, scene) in scenes.iter().enumerate() {
        append_scene(scene, index, &mut bytes)?;
    }
    write_prefix(&mut bytes);
    Ok(bytes)
}

fn append_scene(scene: &Scene, index: usize, bytes: &mut Vec<u8>) -> Result<(), DecodeError> {
    let malformed = |_| Problem::MalformedScene.at(Place::Scene(index));
    let record = postcard::to_allocvec(scene).map_err(malformed)?;
    bytes.extend(postcard::to_allocvec(record.as_slice()).map_err(malformed)?);
    Ok(())
}

fn append_texture(
    texture: &TextureSpec,
    index: usize,
    bytes: &mut Vec<u8>,
) -> Result<(), DecodeError> {
    let mut nodes = Vec::new();
    let mut coefficients = Vec::new();
    for (number, node) in texture.nodes.iter().enumerate() {
        let forces = texture.force_axis_n.len().max(1);
        let place = Place::Node {
            texture: index,
            speed: number / forces,
            force: number % forces,
        };
        let (order, structure) = (node.codes.order(), node.codes.structure());
        if structure != texture.structure {
            let texture = texture.structure;
            let node = structure;
            return Err(Problem::StructureMismatch { node, texture }.at(place));
        }
        if order > limits::MAX_ORDER {
            return Err(Problem::Order(order).at(place));
        }
        let record = NodeRecord {
            order: order as u16,
            flags: node.flags.bits(),
            exponent: node.codes.exponent(),
            output_power: node.output_power,
            prediction_error_power: node.prediction_error_power,
            offset: coefficients.len() as u32,
        };
        nodes.extend(record.bytes());
        node.codes.append_to(&mut coefficients);
    }
    let (speed_axis, force_axis) = (
        axis_bytes(&texture.speed_axis_mm_s),
        axis_bytes(&texture.force_axis_n),
    );
    let margins = texture.cell_margins.as_slice();
    let certificate = match texture.structure {
        Structure::NormalisedLattice if margins.is_empty() => CertificateRecord::Lattice {
            largest_theta_code: largest_theta_code(&texture.nodes),
        },
        _ if margins.is_empty() => CertificateRecord::None,
        _ => CertificateRecord::DirectForm {
            crc32: wire::checksum_of_strings([
                &speed_axis,
                &force_axis,
                &nodes,
                &coefficients,
                margins,
            ]),
            cell_margins: margins,
        },
    };
    let record = TextureRecord {
        name: &texture.name,
        sample_rate_hz: texture.sample_rate_hz,
        structure: texture.structure,
        provenance: texture.provenance,
        speed_axis: &speed_axis,
        force_axis: &force_axis,
        nodes: &nodes,
        coefficients: &coefficients,
        certificate,
    };
    let encoded = postcard::to_allocvec(&record).map_err(|_| {
        let place = Place::Texture(index);
        Problem::Malformed.at(place)
    })?;
    bytes.extend(encoded);
    Ok(())
}

fn largest_theta_code(nodes: &[NodeSpec]) -> u16 {
    let magnitudes = nodes.iter().flat_map(|node| match &node.codes {
        CodeSpec::Lattice(codes) => codes.as_slice(),
        CodeSpec::Direct16 { .. } | CodeSpec::Direct32 { .. } => &[],
    });
    magnitudes.fold(0, |largest, code| largest.max(code.unsigned_abs()))
}

fn axis_bytes(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

/// Fills in the prefix of a library whose body is complete.
fn write_prefix(bytes: &mut [u8]) {
    let mut prefix = Prefix {
        magic: wire::MAGIC,
        version: wire::FORMAT_VERSION,
        reserved: 0,
        total_bytes: bytes.len() as u32,
        crc32: 0,
    };
    for _ in 0..2 {
        // Once to have the bytes that the checksum covers, once with the checksum.
        postcard::to_slice(&prefix, &mut bytes[..wire::PREFIX_BYTES])
            .expect("a prefix of fixed-width fields fits its fixed length");
        prefix.crc32 = wire::checksum(bytes);
    }
}
