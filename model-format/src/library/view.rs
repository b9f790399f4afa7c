//! A validated library.

use super::texture::Texture;
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

impl<'a> Library<'a> {
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
            let (scene, after) = take_scene(rest)?;
            rest = after;
            Some(scene)
        })
    }

    /// The scene of this name, if there is one.
    pub fn scene(&self, name: &str) -> Option<Scene> {
        self.scenes().find(|scene| scene.name == name)
    }
}

/// Parses the scene that `bytes` begin with: the scene, and the bytes after it. None if its record is not exactly a
/// scene.
pub(super) fn take_scene(bytes: &[u8]) -> Option<(Scene, &[u8])> {
    let (record, after) = postcard::take_from_bytes::<&[u8]>(bytes).ok()?;
    let (scene, rest) = postcard::take_from_bytes::<Scene>(record).ok()?;
    rest.is_empty().then_some((scene, after))
}
