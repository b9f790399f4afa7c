//! Faults that decoding and encoding a library report, each with its place.
//!
//! [`Library::decode`](crate::Library::decode) and `encode` return these faults, and `stylus` shows them unchanged.
//! They allocate nothing and contain only `'static` text, because the device reports them too. The package's README
//! explains the fields and their limits.

use core::fmt;

use crate::decimal::Decimal;
use crate::scene::SceneError;
use crate::wire::FORMAT_VERSION;

/// The first fault found in bytes that are not a valid library, or in textures and scenes that were to be encoded.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct DecodeError {
    /// Place of the fault.
    pub place: Place,
    /// The fault.
    pub problem: Problem,
}

/// A place in a library. Textures, nodes, axis values and scenes are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The library as a whole: its prefix, its counts, and bytes after the last scene.
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
            Self::Node { texture, speed, force } => write!(f, "texture {texture}, node (speed {speed}, force {force})"),
            Self::Scene(scene) => write!(f, "scene {scene}"),
        }
    }
}

/// A fault of a library. It is meant to be shown with its place; no program decides by the kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each message says it")]
pub enum Problem {
    #[error("not a texture library (its first bytes are not \"HTXL\")")]
    NotALibrary,
    #[error(
        "format version {found}, and this program reads version {FORMAT_VERSION}: {}",
        if *found > FORMAT_VERSION { "the program is older than the file, update the program" }
        else { "the file is older than the program, fit it again" }
    )]
    Version {
        /// The version in the file.
        found: u16,
    },
    #[error("{found} bytes where the library declares {declared}: truncated, or followed by something else")]
    Length {
        /// Length that the prefix declares, bytes.
        declared: u32,
        /// Number of bytes that were given.
        found: usize,
    },
    #[error("checksum {computed:08x} where {stored:08x} is stored: the bytes were damaged")]
    Checksum {
        /// CRC-32 in the prefix.
        stored: u32,
        /// CRC-32 of the bytes.
        computed: u32,
    },
    #[error("{0} does not parse")]
    Malformed(&'static str),
    #[error("{0} bytes are left over")]
    LeftOver(usize),
    #[error(
        "{what} is {value}; it must be {lowest} to {highest}",
        value = Decimal(*.value),
        lowest = Decimal(.range[0]),
        highest = Decimal(.range[1])
    )]
    Range {
        /// Name of the number, and its unit.
        what: &'static str,
        value: f32,
        /// Lowest and highest allowed value of the number.
        range: [f32; 2],
    },
    #[error("{what}: {found} where {expected} is due")]
    Mismatch {
        /// Name of the number.
        what: &'static str,
        found: usize,
        /// The number that is required.
        expected: usize,
    },
    #[error("{what} of {code:#x}, which this program does not know: update the program")]
    Unknown {
        /// Name of the field that has the code.
        what: &'static str,
        code: u32,
    },
    #[error("the same {what} as number {other}")]
    Taken {
        /// The property that is shared.
        what: &'static str,
        /// Index of the earlier item with this property.
        other: usize,
    },
    #[error("{0} says nothing: leave it out")]
    Needless(&'static str),
    /// A fault of one stage of a lattice.
    #[error("stage {stage} has {what}")]
    Stage {
        /// Number of the stage, from 1.
        stage: usize,
        what: &'static str,
    },
    /// Any other broken rule.
    #[error("{0}")]
    Rule(&'static str),
    /// A scene that cannot be played.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl Problem {
    pub(crate) const fn at(self, place: Place) -> DecodeError {
        DecodeError { place, problem: self }
    }

    /// Checks that `value` is in `range`, both ends included, and is not -0.0.
    pub(crate) fn within(what: &'static str, value: f32, range: [f32; 2]) -> Result<(), Self> {
        let [lowest, highest] = range;
        // A comparison with NaN is false, so that NaN is refused.
        if value >= lowest && value <= highest && value.is_sign_positive() {
            Ok(())
        } else {
            Err(Self::Range { what, value, range })
        }
    }

    /// Checks that the count `found` is in `range`, both ends included.
    pub(crate) fn count(what: &'static str, found: usize, range: [usize; 2]) -> Result<(), Self> {
        let [lowest, highest] = range;
        if (lowest..=highest).contains(&found) {
            return Ok(());
        }
        // A message shows at most six digits, which `f32` can hold.
        let (value, range) = (found as f32, range.map(|end| end as f32));
        Err(Self::Range { what, value, range })
    }

    /// Checks that `found` equals `expected`.
    pub(crate) fn same(what: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected {
            return Ok(());
        }
        Err(Self::Mismatch { what, found, expected })
    }
}
