//! A validated library.

use super::canonical;
use super::texture::Texture;
use crate::error::Problem;
use crate::scene::Scene;

/// A validated texture library, borrowed from its bytes.
#[derive(Clone, Copy, Debug)]
pub struct Library<'a> {
    /// Bytes that follow the texture count.
    pub(super) textures: &'a [u8],
    pub(super) len: usize,
    /// Bytes that follow the scene count.
    pub(super) scenes: &'a [u8],
    pub(super) scene_count: usize,
}

/// Places of a decoded library's content in its bytes.
///
/// This is for a keeper of bytes that cannot stay borrowed, such as a store in flash: it decodes once, keeps the
/// outline, and looks at the bytes again without another decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outline {
    textures: u32,
    len: u16,
    scenes: u32,
    scene_count: u8,
}

impl Outline {
    /// The library of `bytes`, which must be those that were decoded to the library of this outline: its user has to
    /// know, by their checksum for one. Views of other bytes may panic.
    ///
    /// Returns none if the bytes are too few.
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
    /// Places of the content in `bytes`, those that this library was decoded from.
    pub fn outline(&self, bytes: &[u8]) -> Outline {
        // Textures and scenes reach to the end of the bytes, whose number fits in 32 bits.
        let begin = |rest: &[u8]| (bytes.len() - rest.len()) as u32;
        Outline {
            textures: begin(self.textures),
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
        let mut rest = self.textures;
        // Validation has parsed the headers, so that parsing them again does not fail.
        (0..self.len).map_while(move |index| {
            let (texture, after) = Texture::take(rest, index).ok()?;
            rest = after;
            Some(texture)
        })
    }

    /// The texture of this name, if there is one.
    pub fn texture(&self, name: &str) -> Option<Texture<'a>> {
        self.textures().find(|texture| texture.name == name)
    }

    /// Number of scenes, which may be 0.
    pub fn scene_count(&self) -> usize {
        self.scene_count
    }

    /// The scenes, in the order of the file.
    pub fn scenes(&self) -> impl Iterator<Item = Scene> + use<'a> {
        let mut rest = self.scenes;
        // Validation has parsed them, so that parsing them again does not fail.
        (0..self.scene_count).map_while(move |_| {
            let (scene, after) = take_scene(rest).ok()?;
            rest = after;
            Some(scene)
        })
    }

    /// The scene of this name, if there is one.
    pub fn scene(&self, name: &str) -> Option<Scene> {
        self.scenes().find(|scene| scene.name == name)
    }
}

/// Parses the scene that `bytes` begin with: the scene, and the bytes after it.
///
/// # Errors
/// A record that is not exactly a scene, or not in its one form.
pub(super) fn take_scene(bytes: &[u8]) -> Result<(Scene, &[u8]), Problem> {
    let malformed = Problem::MalformedScene;
    let (record, after) = postcard::take_from_bytes::<&[u8]>(bytes).map_err(|_| malformed)?;
    canonical::check(bytes, after, canonical::of_string(record))?;
    let (scene, rest) = postcard::take_from_bytes::<Scene>(record).map_err(|_| malformed)?;
    if !rest.is_empty() {
        return Err(malformed);
    }
    let length = canonical::of_scene(&scene).ok_or(malformed)?;
    canonical::check(record, rest, length)?;
    Ok((scene, after))
}
