//! What is played: a library that several players and threads share, and the choice from it.

use core::fmt;
use std::sync::Arc;

use model_format::scene::SceneError;
use model_format::{DecodeError, Library, Outline, Texture};
use stylus_kernel::scene::Plan;

/// A validated library with its bytes, which live as long as anything plays from them.
#[derive(Clone, Debug)]
pub struct SharedLibrary(Arc<Bytes>);

#[derive(Debug)]
struct Bytes {
    bytes: Vec<u8>,
    outline: Outline,
}

impl SharedLibrary {
    /// Decodes `bytes`.
    pub fn decode(bytes: Vec<u8>) -> Result<Self, DecodeError> {
        let outline = Library::decode(&bytes)?.outline(&bytes);
        Ok(Self(Arc::new(Bytes { bytes, outline })))
    }

    /// The library.
    pub fn library(&self) -> Library<'_> {
        let found = self.0.outline.library(&self.0.bytes);
        found.expect("the outline is that of these bytes")
    }
}

/// A texture or scene, by its place in the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// A texture, everywhere and without effects.
    Texture(usize),
    /// A scene.
    Scene(usize),
}

/// Parts of textures that are left out, for comparisons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Without(u32);

impl Without {
    /// Codebooks: Gaussian noise excites the filter instead.
    pub const CODEBOOKS: Self = Self(1);
    /// Lines that are tied to position.
    pub const LINES: Self = Self(4);

    /// Parts by their bits; others are ignored.
    pub const fn of_bits(bits: u32) -> Self {
        Self(bits & (Self::CODEBOOKS.0 | Self::LINES.0))
    }

    const fn has(self, part: Self) -> bool {
        self.0 & part.0 != 0
    }

    fn of(self, mut texture: Texture<'_>) -> Texture<'_> {
        if self.has(Self::CODEBOOKS) {
            texture = texture.without_codebooks();
        }
        if self.has(Self::LINES) {
            texture = texture.without_lines();
        }
        texture
    }
}

/// Returns the plan of `selection` from `library`, without the parts in `without`.
pub fn plan_of<'a>(library: &Library<'a>, selection: Selection, without: Without) -> Result<Plan<'a>, ChoiceError> {
    let plan = match selection {
        Selection::Texture(index) => {
            let count = library.len();
            let texture = library.texture_at(index);
            Plan::of_texture(texture.ok_or(ChoiceError::NoTexture { index, count })?)
        }
        Selection::Scene(index) => {
            let count = library.scene_count();
            let scene = library.scene_at(index);
            let scene = scene.ok_or(ChoiceError::NoScene { index, count })?;
            Plan::new(&scene, library).map_err(ChoiceError::Scene)?
        }
    };
    Ok(plan.with_textures(|texture| without.of(texture)))
}

/// A choice that the library does not have.
#[derive(Clone, Debug, PartialEq)]
pub enum ChoiceError {
    /// An index that no texture has.
    NoTexture {
        /// The index.
        index: usize,
        /// Number of textures.
        count: usize,
    },
    /// An index that no scene has.
    NoScene {
        /// The index.
        index: usize,
        /// Number of scenes.
        count: usize,
    },
    /// A scene that cannot be played with the library's textures.
    Scene(SceneError),
}

impl fmt::Display for ChoiceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, index, count) = match self {
            Self::NoTexture { index, count } => ("texture", index, count),
            Self::NoScene { index, count } => ("scene", index, count),
            Self::Scene(error) => return write!(f, "the scene cannot be played: {error}"),
        };
        write!(f, "there is no {kind} {index}: the library has {count}, counted from 0")
    }
}

impl core::error::Error for ChoiceError {}
