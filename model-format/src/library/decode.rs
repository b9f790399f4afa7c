//! From bytes to a [`Library`], or to the first fault and its place.

use super::canonical;
use super::check::{Demand, check_texture};
use super::texture::Texture;
use super::view::{Library, take_scene};
use crate::error::{DecodeError, Place, Problem};
use crate::limits;
use crate::scene::limits::MAX_SCENES;
use crate::wire::{self, Prefix};

impl<'a> Library<'a> {
    /// Checks `bytes` from the first to the last and returns a view of them.
    ///
    /// The work is bounded by a constant per byte. Nothing is copied but one scene at a time.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::decode_demanding(bytes, Demand::Certificate)
    }

    /// As [`Library::decode`], but accepts direct forms without a certificate, which may be unstable between their
    /// nodes.
    ///
    /// This is for benches that examine such textures; a stylus must not play them.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn decode_uncertified(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::decode_demanding(bytes, Demand::Nothing)
    }

    fn decode_demanding(bytes: &'a [u8], demand: Demand) -> Result<Self, DecodeError> {
        let at = |problem: Problem| problem.at(Place::Library);
        if !bytes.starts_with(&wire::MAGIC) {
            return Err(at(Problem::NotALibrary));
        }
        let found = bytes.len();
        let (prefix, body) = postcard::take_from_bytes::<Prefix>(bytes)
            .map_err(|_| at(Problem::TooShort { found }))?;
        if prefix.version != wire::FORMAT_VERSION {
            let found = prefix.version;
            return Err(at(Problem::Version { found }));
        }
        if prefix.total_bytes as usize != found {
            let declared = prefix.total_bytes;
            return Err(at(Problem::Length { declared, found }));
        }
        if found > limits::MAX_LIBRARY_BYTES {
            return Err(at(Problem::TooLarge { found }));
        }
        let (stored, computed) = (prefix.crc32, wire::checksum(bytes));
        if stored != computed {
            return Err(at(Problem::Checksum { stored, computed }));
        }
        if prefix.reserved != 0 {
            return Err(at(Problem::Reserved));
        }
        let (count, textures) =
            postcard::take_from_bytes::<u32>(body).map_err(|_| at(Problem::TooShort { found }))?;
        canonical::check(body, textures, canonical::of_number(count)).map_err(at)?;
        let len = count as usize;
        if len == 0 || len > limits::MAX_TEXTURES {
            return Err(at(Problem::TextureCount(len)));
        }
        let mut library = Self {
            textures,
            len,
            scenes: &[],
            scene_count: 0,
        };
        let rest = library.validate_textures(demand)?;
        let Some((&count, scenes)) = rest.split_first() else {
            return Err(at(Problem::NoSceneCount));
        };
        (library.scenes, library.scene_count) = (scenes, usize::from(count));
        if library.scene_count > MAX_SCENES {
            return Err(at(Problem::SceneCount(library.scene_count)));
        }
        library.validate_scenes()?;
        Ok(library)
    }

    /// Checks the textures, and returns the bytes after them.
    fn validate_textures(&self, demand: Demand) -> Result<&'a [u8], DecodeError> {
        let mut rest = self.textures;
        // Kept, so that the comparison of all pairs reads no header again.
        let mut names = [""; limits::MAX_TEXTURES];
        for index in 0..self.len {
            let (texture, after) = Texture::take(rest, index)?;
            check_texture(&texture, index, demand)?;
            let (name, earlier) = (texture.name, &names[..index]);
            if let Some(other) = earlier.iter().position(|&other| other == name) {
                return Err(Problem::NameTaken(other).at(Place::Texture(index)));
            }
            (names[index], rest) = (name, after);
        }
        Ok(rest)
    }

    fn validate_scenes(&self) -> Result<(), DecodeError> {
        let mut rest = self.scenes;
        for index in 0..self.scene_count {
            let here = |problem: Problem| problem.at(Place::Scene(index));
            let (scene, after) = take_scene(rest).map_err(here)?;
            scene.validate(self).map_err(|error| here(error.into()))?;
            let mut earlier = self.scenes().take(index);
            if let Some(other) = earlier.position(|other| other.name == scene.name) {
                return Err(here(Problem::SceneNameTaken(other)));
            }
            rest = after;
        }
        if rest.is_empty() {
            Ok(())
        } else {
            Err(Problem::LeftOver(rest.len()).at(Place::Library))
        }
    }
}
