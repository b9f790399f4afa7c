//! Why bytes are not a library, and where.

use core::fmt;

use crate::limits;
use crate::scene::SceneError;
use crate::scene::limits::MAX_SCENES;
use crate::wire::{FORMAT_VERSION, Structure};

/// Bytes that are not a library that the stylus can play.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct DecodeError {
    /// Where the fault is.
    pub place: Place,
    /// What it is.
    pub problem: Problem,
}

/// A place in a library. Textures, nodes, axis values and scenes are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The whole file or its first bytes.
    Library,
    /// A texture.
    Texture(usize),
    /// A texture's speed axis.
    SpeedAxis(usize),
    /// A texture's force axis.
    ForceAxis(usize),
    /// A node of a texture's grid.
    Node {
        /// The texture.
        texture: usize,
        /// Index on the speed axis.
        speed: usize,
        /// Index on the force axis.
        force: usize,
    },
    /// A cell of a texture's grid: what lies between neighbouring nodes.
    Cell {
        /// The texture.
        texture: usize,
        /// Index on the speed axis of the cell's lowest speed.
        speed: usize,
        /// Index on the force axis of its lowest force.
        force: usize,
    },
    /// A scene.
    Scene(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Library => f.write_str("library"),
            Self::Texture(texture) => write!(f, "texture {texture}"),
            Self::SpeedAxis(texture) => write!(f, "texture {texture}, speed axis"),
            Self::ForceAxis(texture) => write!(f, "texture {texture}, force axis"),
            Self::Node {
                texture,
                speed,
                force,
            } => write!(f, "texture {texture}, node (speed {speed}, force {force})"),
            Self::Cell {
                texture,
                speed,
                force,
            } => write!(
                f,
                "texture {texture}, cell from node (speed {speed}, force {force}) up"
            ),
            Self::Scene(scene) => write!(f, "scene {scene}"),
        }
    }
}

/// What is wrong with a library.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The first bytes are not those of a library.
    #[error("not a texture library (its first bytes are not \"HTXL\")")]
    NotALibrary,
    /// Another format's version.
    #[error(
        "format version {found}, and this program reads version {FORMAT_VERSION}: {}",
        if *found > FORMAT_VERSION { "the program is older than the file, update the program" }
        else { "the file is older than the program, fit it again" }
    )]
    Version {
        /// The version in the file.
        found: u16,
    },
    /// Fewer or more bytes than the library says it has.
    #[error(
        "{found} bytes where the library declares {declared}: truncated, or followed by something else"
    )]
    Length {
        /// What the prefix declares.
        declared: u32,
        /// How many bytes there are.
        found: usize,
    },
    /// Too few bytes for anything.
    #[error("{found} bytes are too few for a library")]
    TooShort {
        /// How many bytes there are.
        found: usize,
    },
    /// More than a slot holds.
    #[error(
        "{found} bytes are more than the {} that a slot holds",
        limits::MAX_LIBRARY_BYTES
    )]
    TooLarge {
        /// How many bytes there are.
        found: usize,
    },
    /// The bytes are not those that were written.
    #[error("checksum {computed:08x} where {stored:08x} is stored: the bytes were damaged")]
    Checksum {
        /// The CRC-32 in the file.
        stored: u32,
        /// The CRC-32 of its bytes.
        computed: u32,
    },
    /// A field that must be zero is not.
    #[error("a reserved field is not zero")]
    Reserved,
    /// A node whose coefficients are for another structure than its texture's. Only writers can come upon it.
    #[error(
        "coefficients for the structure \"{node}\" in a texture of the structure \"{texture}\""
    )]
    StructureMismatch {
        /// What the node's coefficients are for.
        node: Structure,
        /// The texture's structure.
        texture: Structure,
    },
    /// The texture's header does not parse.
    #[error("the header does not parse")]
    Malformed,
    /// Bytes are left after the last scene.
    #[error("{0} bytes are left over after the last scene")]
    LeftOver(usize),
    /// No texture, or too many.
    #[error("{0} textures; there must be 1 to {max}", max = limits::MAX_TEXTURES)]
    TextureCount(usize),
    /// The bytes end after the last texture.
    #[error("it ends where the number of its scenes is due")]
    NoSceneCount,
    /// Too many scenes.
    #[error("{0} scenes; there must be at most {MAX_SCENES}")]
    SceneCount(usize),
    /// A record that is no scene, or more than one.
    #[error("its record does not parse as a scene")]
    MalformedScene,
    /// A scene of the same name.
    #[error("the same name as scene {0}")]
    SceneNameTaken(usize),
    /// A scene that cannot be played.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A name that is empty or too long.
    #[error("a name of {0} bytes; there must be 1 to {max}", max = limits::MAX_NAME_BYTES)]
    NameLength(usize),
    /// A name with characters that cannot be typed or shown.
    #[error("a name with a control character")]
    NameCharacter,
    /// Two textures of one name.
    #[error("the same name as texture {0}")]
    NameTaken(usize),
    /// A sample rate of zero, or too high.
    #[error("a sample rate of {0} Hz; there must be 1 to {max}", max = limits::MAX_SAMPLE_RATE_HZ)]
    SampleRate(u32),
    /// An axis without values, or with too many.
    #[error("{0} values; there must be 1 to {max}", max = limits::MAX_AXIS_LEN)]
    AxisLength(usize),
    /// A byte string that holds no whole number of records.
    #[error("{found} bytes are no whole number of records of {record} bytes")]
    Ragged {
        /// Length of the string.
        found: usize,
        /// Length of one record.
        record: usize,
    },
    /// A value on an axis that is negative or not finite.
    #[error("value {index} is {value}; it must be finite and not negative")]
    AxisValue {
        /// Which value.
        index: usize,
        /// What it is.
        value: f32,
    },
    /// Values on an axis that do not ascend.
    #[error("value {index} is not greater than the one before; the axis must ascend")]
    AxisOrder {
        /// Which value.
        index: usize,
    },
    /// More or fewer nodes than the axes span.
    #[error("{found} nodes where the axes span {expected}")]
    NodeCount {
        /// How many are there.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// An order above the limit.
    #[error("order {0}; the highest is {max}", max = limits::MAX_ORDER)]
    Order(usize),
    /// Flags that this version does not know.
    #[error("unknown flags {0:#04x}")]
    Flags(u8),
    /// A power that is negative, too large or not finite.
    #[error(
        "{what} power is {value} (m/s²)²; it must be finite, not negative and at most {}",
        limits::MAX_OUTPUT_POWER
    )]
    Power {
        /// Which of the powers: "output" or "prediction error".
        what: &'static str,
        /// What it is.
        value: f32,
    },
    /// The model's input would be stronger than its output.
    #[error("the prediction error's power is above the output's")]
    PowerOrder,
    /// The silent flag and the power disagree.
    #[error("the silent flag is set exactly where the output power is zero; here they disagree")]
    SilentFlag,
    /// A node at rest or out of contact that is not silent.
    #[error("a node at speed 0 or force 0 must be silent")]
    NotSilentAtZero,
    /// Coefficients that do not lie one node after the other.
    #[error("coefficients begin at byte {found} where {expected} is due")]
    Offset {
        /// Where they begin.
        found: u32,
        /// Where the previous node's end.
        expected: usize,
    },
    /// More or fewer coefficient bytes than the nodes use.
    #[error("{found} bytes of coefficients where the nodes use {expected}")]
    CoefficientLength {
        /// How many are there.
        found: usize,
        /// How many the nodes use.
        expected: usize,
    },
    /// An exponent that this structure does not have.
    #[error("exponent {exponent} in a {structure}; the highest is {highest}")]
    Exponent {
        /// What is stored.
        exponent: u8,
        /// The texture's structure.
        structure: Structure,
        /// The highest that is allowed.
        highest: u8,
    },
    /// A reflection coefficient of magnitude one: a stage that never forgets.
    #[error("stage {stage} has a reflection coefficient of magnitude 1")]
    ReflectionCoefficient {
        /// Which stage, from 1.
        stage: usize,
    },
    /// Coefficients so large that the kernel's sums could overflow.
    #[error(
        "the coefficients' magnitudes add up to more than {}",
        limits::MAX_COEFFICIENT_SUM
    )]
    CoefficientSum,
    /// A direct form without a certificate.
    #[error(
        "a {0} without a certificate may be unstable between its nodes: fit it again, as a lattice if need be"
    )]
    Uncertified(Structure),
    /// A certificate for another structure than the texture's.
    #[error("the certificate is not one for a {0}")]
    CertificateKind(Structure),
    /// A certificate whose bound on θ is not the nodes' own.
    #[error("the certificate bounds |θ| by code {stored}, and the nodes' largest is {found}")]
    CertifiedTheta {
        /// What is stored.
        stored: u16,
        /// What the nodes have.
        found: u16,
    },
    /// A certificate for more or fewer cells than there are.
    #[error("the certificate is for {found} cells where the axes span {expected}")]
    CertifiedCells {
        /// How many it is for.
        found: usize,
        /// How many there are.
        expected: usize,
    },
    /// A certificate that was issued for other axes, nodes or coefficients.
    #[error(
        "the certificate is for other coefficients: checksum {computed:08x} where {stored:08x} is stored"
    )]
    CertificateChecksum {
        /// The CRC-32 in the certificate.
        stored: u32,
        /// That of the texture.
        computed: u32,
    },
    /// A cell that is not stable throughout, or of which that is not known.
    #[error("the certificate does not hold here: fit the texture as a lattice")]
    UncertifiedCell,
}

impl Problem {
    pub(crate) const fn at(self, place: Place) -> DecodeError {
        DecodeError {
            place,
            problem: self,
        }
    }
}
