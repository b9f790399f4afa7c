//! Optional parts of a texture: what a texture may say beside its models, a kind each.
//!
//! | kind | file | content |
//! |---|---|---|
//! | 1 | [`levels`] | laws of the level between nodes and below the grid |
//! | 2 | [`fine_theta`] | 8 more binary digits of θ for the first stages of a lattice |
//!
//! A texture ends with a varint of the number of its parts, and each part is a varint of its kind and a string of its
//! content. Kinds ascend, so that none comes twice. An unknown kind is refused, because a reader that left it out would
//! play another texture than the one that was written. A part that says only what its absence says is refused too, so
//! that a texture has one form of bytes.
//!
//! A new kind is a file here with its `KIND`, its reader, its check and its writer; a field of [`Parts`] and the lines
//! that name it below; and a row in the package's README.

pub(crate) mod fine_theta;
pub(crate) mod levels;
mod subject;

use super::canonical;
use crate::error::{DecodeError, Problem};

use fine_theta::FineTheta;
use levels::LevelsPart;

#[cfg(feature = "alloc")]
pub(crate) use subject::PartSpec;
pub(super) use subject::Subject;

/// A kind of optional part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartKind {
    /// Laws of the level between nodes and below the grid.
    Levels,
    /// Fractions of θ of a lattice's first stages.
    FineTheta,
}

impl core::fmt::Display for PartKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Levels => "levels",
            Self::FineTheta => "fine theta",
        })
    }
}

/// The optional parts of a texture, borrowed from its bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Parts<'a> {
    pub levels: Option<LevelsPart<'a>>,
    pub fine_theta: Option<FineTheta<'a>>,
}

impl<'a> Parts<'a> {
    /// Parses the parts that `bytes` begin with: the parts, and the bytes after them. Contents are not judged.
    ///
    /// The number of parts needs no bound of its own, because known kinds that ascend are few.
    pub fn take(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), Problem> {
        let malformed = |_| Problem::MalformedParts;
        let (count, mut rest) = postcard::take_from_bytes::<u32>(bytes).map_err(malformed)?;
        canonical::check(bytes, rest, canonical::of_number(count))?;
        let mut parts = Self::default();
        let mut last = 0;
        for _ in 0..count {
            let ((kind, content), after) =
                postcard::take_from_bytes::<(u32, &'a [u8])>(rest).map_err(malformed)?;
            let length = canonical::of_number(kind) + canonical::of_string(content);
            canonical::check(rest, after, length)?;
            match kind {
                levels::KIND => parts.levels = Some(LevelsPart(content)),
                fine_theta::KIND => parts.fine_theta = Some(FineTheta(content)),
                unknown => return Err(Problem::UnknownPart(unknown)),
            }
            if kind <= last {
                return Err(Problem::PartOrder { kind });
            }
            (last, rest) = (kind, after);
        }
        Ok((parts, rest))
    }

    /// Checks the contents of all parts of `subject`.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn check(&self, subject: &Subject<'_>) -> Result<(), DecodeError> {
        if let Some(levels) = self.levels {
            levels.check().map_err(|problem| subject.error(problem))?;
            levels::check_nodes(levels.laws().level, subject)?;
        }
        if let Some(fine_theta) = self.fine_theta {
            fine_theta.check(subject)?;
        }
        Ok(())
    }

    /// The parts that are there, kinds ascending, each with the length of its content, bytes.
    pub fn lengths(&self) -> impl Iterator<Item = (PartKind, usize)> + use<> {
        let levels = self.levels.map(|part| (PartKind::Levels, part.0.len()));
        let fine_theta = self
            .fine_theta
            .map(|part| (PartKind::FineTheta, part.0.len()));
        [levels, fine_theta].into_iter().flatten()
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
