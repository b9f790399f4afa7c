//! Reading of a library: decoding and validation of any bytes, and views into bytes that were found valid.
//!
//! | file | content |
//! |---|---|
//! | here | [`Library`], which is valid, and its textures and scenes |
//! | `texture`, `node` | the parts of a texture |
//! | `part` | the optional parts of a texture, one file per kind |
//! | `decode` | from bytes to [`Library`]: prefix, textures, scenes, in steps |
//! | `check` | all rules that a texture must keep |
//! | `names` | names that were found so far |
//!
//! Views allocate nothing. They parse bytes that validation has already parsed, so that this parsing cannot fail.

mod check;
mod decode;
mod names;
mod node;
pub(crate) mod part;
mod texture;

use crate::scene::Scene;
use crate::wire::Reader;

pub use decode::{Decoder, Workspace};
#[cfg(feature = "alloc")]
pub(crate) use node::theta;
pub use node::{Coefficients, Node, NodeFlags, Tail};
#[cfg(feature = "alloc")]
pub use part::PartsSpec;
pub use part::excitation::{Codebook, Excitation};
#[cfg(feature = "alloc")]
pub use part::excitation::{CodebookSpec, ExcitationSpec};
pub use part::levels::{FadeLaw, Laws, LevelLaw};
pub use part::lines::{Line, Lines};
#[cfg(feature = "alloc")]
pub use part::lines::{LineSpec, LinesSpec};
#[cfg(feature = "alloc")]
pub use part::tails::TailSpec;
pub use part::wander::Wander;
pub use part::{BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, PartKind, SHARE_FRACTION_BITS, block_scale, block_share};
pub use texture::{Axis, Texture};

/// A validated texture library, borrowed from its bytes.
#[derive(Clone, Copy, Debug)]
pub struct Library<'a> {
    /// Bytes that follow the texture count.
    textures: &'a [u8],
    len: usize,
    /// Bytes that follow the scene count.
    scenes: &'a [u8],
    scene_count: usize,
}

/// Where the textures and scenes of a decoded library begin in its bytes, and how many there are.
///
/// An outline serves an owner whose bytes cannot stay borrowed, such as a store in flash. The owner decodes the bytes
/// once, keeps the outline, and can later view the library again without decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outline {
    textures: u32,
    len: u16,
    scenes: u32,
    scene_count: u8,
}

impl Outline {
    /// Returns the library in `bytes`, which must be the bytes from which this outline's library was decoded. The
    /// caller must make sure of this, for example by a checksum. Views of other bytes may panic.
    ///
    /// Returns none if there are too few bytes.
    pub fn library(self, bytes: &[u8]) -> Option<Library<'_>> {
        Some(Library {
            textures: bytes.get(self.textures as usize..)?,
            len: usize::from(self.len),
            scenes: bytes.get(self.scenes as usize..)?,
            scene_count: usize::from(self.scene_count),
        })
    }
}

impl<'a> Library<'a> {
    /// Offsets of the content in `bytes`, from which this library must have been decoded.
    pub fn outline(&self, bytes: &[u8]) -> Outline {
        // `textures` and `scenes` both reach to the end of `bytes`. The number of bytes fits in 32 bits.
        let begin = |rest: &[u8]| (bytes.len() - rest.len()) as u32;
        Outline {
            textures: begin(self.textures),
            // A library has at most 256 textures and 32 scenes.
            len: self.len as u16,
            scenes: begin(self.scenes),
            scene_count: self.scene_count as u8,
        }
    }

    /// Number of textures, at least one.
    #[expect(clippy::len_without_is_empty, reason = "a library is never empty")]
    pub fn len(&self) -> usize {
        self.len
    }

    /// The textures, in the order of the file.
    pub fn textures(&self) -> impl Iterator<Item = Texture<'a>> + use<'a> {
        // Validation has parsed the headers, so that parsing them again does not fail.
        let records = self.records().enumerate();
        records.map_while(|(index, record)| Texture::parse(record, index).ok())
    }

    /// Texture number `index` in the order of the file, if it exists. Textures before it are not parsed.
    pub fn texture_at(&self, index: usize) -> Option<Texture<'a>> {
        let record = self.records().nth(index)?;
        Texture::parse(record, index).ok()
    }

    /// The texture of this name, if there is one. Of the textures before it, only the names are read.
    pub fn texture(&self, name: &str) -> Option<Texture<'a>> {
        let mut records = self.records().enumerate();
        let (index, record) = records.find(|(_, r)| Texture::name_of(r) == Some(name.as_bytes()))?;
        Texture::parse(record, index).ok()
    }

    /// The bytes of each texture.
    pub(crate) fn records(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let mut reader = Reader(self.textures);
        (0..self.len).map_while(move |_| reader.string())
    }

    /// Number of scenes, which may be 0.
    pub fn scene_count(&self) -> usize {
        self.scene_count
    }

    /// The scenes, in the order of the file.
    pub fn scenes(&self) -> impl Iterator<Item = Scene> + use<'a> {
        // Validation has parsed the scenes, so that parsing them again does not fail.
        self.scene_records().map_while(Scene::parse)
    }

    /// Scene number `index` in the order of the file, if it exists. Scenes before it are not parsed.
    pub fn scene_at(&self, index: usize) -> Option<Scene> {
        self.scene_records().nth(index).and_then(Scene::parse)
    }

    /// The scene of this name, if there is one. Of the scenes before it, only the names are read.
    pub fn scene(&self, name: &str) -> Option<Scene> {
        let is_it = |record: &&[u8]| Scene::name_of(record) == Some(name.as_bytes());
        self.scene_records().find(is_it).and_then(Scene::parse)
    }

    /// The bytes of each scene.
    fn scene_records(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let mut reader = Reader(self.scenes);
        (0..self.scene_count).map_while(move |_| reader.string())
    }
}
