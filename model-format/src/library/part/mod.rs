//! Optional parts of a texture in addition to its models, one of each kind at most.
//!
//! | kind | file | content |
//! |---|---|---|
//! | 1 | [`levels`] | laws of the level between nodes and below the grid |
//! | 2 | [`fine_theta`] | 8 more binary digits of θ for the first stages of a lattice |
//! | 3 | [`excitation`] | codebooks of the prediction residual |
//! | 5 | [`lines`] | lines that are tied to position |
//! | 6 | [`tails`] | θ in one byte for the last stages of a lattice, with a step per node |
//! | 7 | [`wander`] | irregular displacement of lines |
//!
//! Kinds 4 and 8 belonged to earlier versions of the format.
//!
//! A texture ends with the number of its parts, a varint, and the parts. Each part is its kind, a varint, and its
//! content, a string. Kinds ascend, so that no kind comes twice. An unknown kind is refused, because a reader that
//! ignored it would play a texture that differs from the one that was written. A part that only states the default is
//! refused too, so that a texture has only one encoding.
//!
//! A new kind needs a file here with its `KIND`, its reader, its check and its writer; a field of [`Parts`], and a line
//! for this field wherever the code below lists all fields; and a row in the package's README.

mod blocks;
pub(crate) mod excitation;
pub(crate) mod fine_theta;
pub(crate) mod levels;
pub(crate) mod lines;
pub(crate) mod tails;
pub(crate) mod wander;

use crate::error::Problem;
use crate::wire::Reader;

use excitation::ExcitationPart;
use fine_theta::FineTheta;
use levels::LevelsPart;
use lines::LinesPart;
use tails::Tails;
use wander::WanderPart;

pub use blocks::{BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, SHARE_FRACTION_BITS, block_scale, block_share};

/// Kind and content of a part to be written.
#[cfg(feature = "alloc")]
pub(crate) type PartSpec = (u32, alloc::vec::Vec<u8>);

/// Optional parts of a texture to be written, in addition to those that follow from its laws and nodes.
///
/// By default there are none: a Gaussian excitation, and nothing that is tied to position.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartsSpec {
    /// Codebooks of the residual.
    pub excitation: Option<excitation::ExcitationSpec>,
    /// Lines that are tied to position.
    pub lines: Option<lines::LinesSpec>,
}

/// A kind of optional part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartKind {
    /// Laws of the level between nodes and below the grid.
    Levels,
    /// Fractions of θ of a lattice's first stages.
    FineTheta,
    /// Codebooks of the prediction residual.
    Excitation,
    /// Lines that are tied to position.
    Lines,
    /// θ of a lattice's last stages in one byte.
    Tails,
    /// Irregular displacement of lines.
    Wander,
}

impl core::fmt::Display for PartKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Levels => "levels",
            Self::FineTheta => "fine theta",
            Self::Excitation => "excitation",
            Self::Lines => "lines",
            Self::Tails => "tails",
            Self::Wander => "wander",
        })
    }
}

/// The optional parts of a texture, borrowed from its bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Parts<'a> {
    pub levels: Option<LevelsPart<'a>>,
    pub fine_theta: Option<FineTheta<'a>>,
    pub excitation: Option<ExcitationPart<'a>>,
    pub lines: Option<LinesPart<'a>>,
    pub tails: Option<Tails<'a>>,
    pub wander: Option<WanderPart<'a>>,
}

impl<'a> Parts<'a> {
    /// Parses the parts at the reader's position without checking their contents.
    ///
    /// The number of parts needs no bound of its own, because kinds must be known and must ascend.
    pub fn read(reader: &mut Reader<'a>) -> Result<Self, Problem> {
        let malformed = Problem::Malformed("an optional part");
        let count = reader.varint().ok_or(malformed)?;
        let mut parts = Self::default();
        let mut last = 0;
        for _ in 0..count {
            let kind = reader.varint().ok_or(malformed)?;
            let content = reader.string().ok_or(malformed)?;
            match kind {
                levels::KIND => parts.levels = Some(LevelsPart(content)),
                fine_theta::KIND => parts.fine_theta = Some(FineTheta(content)),
                excitation::KIND => parts.excitation = Some(ExcitationPart(content)),
                lines::KIND => parts.lines = Some(LinesPart(content)),
                tails::KIND => parts.tails = Some(Tails(content)),
                wander::KIND => parts.wander = Some(WanderPart(content)),
                code => {
                    let what = "an optional part";
                    return Err(Problem::Unknown { what, code });
                }
            }
            // Ascending kinds have one order, and so a texture has one encoding.
            if kind <= last {
                return Err(Problem::Rule("a part comes twice, or after one of a higher kind"));
            }
            last = kind;
        }
        Ok(parts)
    }

    /// Checks the parts of a texture with `nodes` nodes, and the rules between parts. Blocks,
    /// amplitudes of lines and values per node are checked later, in steps.
    pub fn check(&self, nodes: usize) -> Result<(), Problem> {
        // By name, so that no part is forgotten.
        let Self {
            levels,
            fine_theta,
            excitation,
            lines,
            tails,
            wander,
        } = *self;
        levels.map_or(Ok(()), LevelsPart::check)?;
        fine_theta.map_or(Ok(()), |part| part.check(nodes))?;
        excitation.map_or(Ok(()), |part| part.check(nodes))?;
        lines.map_or(Ok(()), |part| part.check(nodes))?;
        tails.map_or(Ok(()), |part| part.check(nodes))?;
        wander.map_or(Ok(()), |part| part.check(lines.map_or(0, LinesPart::count)))
    }

    /// The parts that the texture has, by ascending kind, each with the length of its content, bytes.
    pub fn lengths(&self) -> impl Iterator<Item = (PartKind, usize)> + use<> {
        let Self {
            levels,
            fine_theta,
            excitation,
            lines,
            tails,
            wander,
        } = self;
        let of = |kind, content: Option<&[u8]>| content.map(|content| (kind, content.len()));
        let parts = [
            of(PartKind::Levels, levels.map(|part| part.0)),
            of(PartKind::FineTheta, fine_theta.map(|part| part.0)),
            of(PartKind::Excitation, excitation.map(|part| part.0)),
            of(PartKind::Lines, lines.map(|part| part.0)),
            of(PartKind::Tails, tails.map(|part| part.0)),
            of(PartKind::Wander, wander.map(|part| part.0)),
        ];
        parts.into_iter().flatten()
    }
}

/// Appends `parts` to `bytes`. Kinds must ascend.
#[cfg(feature = "alloc")]
pub(crate) fn append(parts: &[PartSpec], bytes: &mut alloc::vec::Vec<u8>) -> postcard::Result<()> {
    bytes.extend(postcard::to_allocvec(&(parts.len() as u32))?);
    for (kind, content) in parts {
        bytes.extend(postcard::to_allocvec(&(kind, content.as_slice()))?);
    }
    Ok(())
}
