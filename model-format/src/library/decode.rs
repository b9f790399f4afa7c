//! From bytes to a [`Library`], or to the first fault and its place.
//!
//! [`Decoder`] does it in bounded steps, for a device that has other things to do in between; [`Library::decode`] is
//! the loop over it. A new kind of check is a variant of [`Stage`] with its state, entered from the stage before it.

use super::check::{CertificateCheck, Demand, NodesCheck, check_header};
use super::names::Names;
use super::texture::Texture;
use super::view::Library;
use crate::error::{DecodeError, Place, Problem};
use crate::limits::{MAX_LIBRARY_BYTES, MAX_TEXTURES, STEP_BYTES};
use crate::scene::limits::MAX_SCENES;
use crate::scene::{Scene, TextureBounds};
use crate::wire::{self, CRC_RANGE, Prefix, Reader};

/// A decoding in steps, each of which takes a bounded time; [`crate::limits`] has the bound.
///
/// ```
/// # use model_format::{CodeSpec, Laws, NodeFlags, NodeSpec, Provenance, SAMPLE_RATE_HZ, Structure, TextureSpec};
/// use model_format::{Decoder, encode};
/// # let node = NodeSpec {
/// #     output_power: 4.0,
/// #     prediction_error_power: 1.0,
/// #     flags: NodeFlags::NONE,
/// #     codes: CodeSpec::lattice(vec![-20_000]),
/// # };
/// # let textures = [TextureSpec {
/// #     name: "denim".into(),
/// #     sample_rate_hz: SAMPLE_RATE_HZ,
/// #     structure: Structure::NormalisedLattice,
/// #     provenance: Provenance::Simulated,
/// #     laws: Laws::default(),
/// #     speed_axis_mm_s: vec![100.0],
/// #     force_axis_n: vec![1.0],
/// #     nodes: vec![node],
/// #     cell_margins: vec![],
/// # }];
///
/// let bytes = encode(&textures)?;
/// let mut decoder = Decoder::new(&bytes);
/// let library = loop {
///     if let Some(library) = decoder.step()? {
///         break library;
///     }
///     // Here others have their turn.
/// };
/// assert_eq!(library.len(), 1);
/// # Ok::<(), model_format::DecodeError>(())
/// ```
#[derive(Clone)]
pub struct Decoder<'a> {
    bytes: &'a [u8],
    demand: Demand,
    stage: Stage<'a>,
    /// The bytes that no stage has taken yet.
    rest: Reader<'a>,
    /// The library as far as it was read. Nobody sees it before the last step.
    library: Library<'a>,
    /// Number of textures that were found valid, and of scenes.
    textures: usize,
    scenes: usize,
    texture_names: Names<'a, MAX_TEXTURES>,
    scene_names: Names<'a, MAX_SCENES>,
    /// The facts of each texture that scenes are checked against.
    bounds: [TextureBounds; MAX_TEXTURES],
}

/// The subject of the next step.
#[derive(Clone)]
enum Stage<'a> {
    /// Prefix: magic, version, length.
    Prefix,
    /// Checksum of the whole: that of the bytes before `at`.
    Checksum {
        stored: u32,
        at: usize,
        digest: crc::Digest<'static, u32>,
    },
    /// Header of the next texture, or the number of scenes.
    Texture,
    /// Nodes of a texture.
    Nodes(NodesCheck<'a>),
    /// Certificate of a texture.
    Certificate(CertificateCheck<'a>),
    /// The next scene, or the end.
    Scene,
}

impl<'a> Decoder<'a> {
    /// A decoder of `bytes`, which has looked at none yet.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self::demanding(bytes, Demand::Certificate)
    }

    const fn demanding(bytes: &'a [u8], demand: Demand) -> Self {
        Self {
            bytes,
            demand,
            stage: Stage::Prefix,
            rest: Reader(&[]),
            library: Library {
                textures: &[],
                len: 0,
                scenes: &[],
                scene_count: 0,
            },
            textures: 0,
            scenes: 0,
            texture_names: Names::new(),
            scene_names: Names::new(),
            bounds: [TextureBounds::NONE; MAX_TEXTURES],
        }
    }

    /// Takes one step; returns the library after the last one. A further call begins anew, as one after an error does.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn step(&mut self) -> Result<Option<Library<'a>>, DecodeError> {
        match core::mem::replace(&mut self.stage, Stage::Prefix) {
            Stage::Prefix => {
                (self.textures, self.scenes) = (0, 0);
                self.texture_names.clear();
                self.scene_names.clear();
                self.stage = self.prefix()?;
            }
            Stage::Checksum { stored, at, digest } => {
                self.stage = self.checksum(stored, at, digest)?;
            }
            Stage::Texture => self.stage = self.texture()?,
            Stage::Nodes(mut nodes) => {
                self.stage = match nodes.step()? {
                    None => Stage::Nodes(nodes),
                    Some(largest_theta) => {
                        let (texture, index) = nodes.texture();
                        let certificate =
                            CertificateCheck::new(texture, index, self.demand, largest_theta);
                        Stage::Certificate(certificate)
                    }
                };
            }
            Stage::Certificate(mut certificate) => {
                self.stage = if certificate.step()? {
                    Stage::Texture
                } else {
                    Stage::Certificate(certificate)
                };
            }
            Stage::Scene => {
                if self.scenes == self.library.scene_count {
                    return self.end().map(Some);
                }
                self.scene()?;
                self.stage = Stage::Scene;
            }
        }
        Ok(None)
    }

    /// Checks magic, version and length before all else, and the length before the checksum.
    fn prefix(&self) -> Result<Stage<'a>, DecodeError> {
        let at = |problem: Problem| problem.at(Place::Library);
        if !self.bytes.starts_with(&wire::MAGIC) {
            return Err(at(Problem::NotALibrary));
        }
        let found = self.bytes.len();
        let (prefix, _) = postcard::take_from_bytes::<Prefix>(self.bytes)
            .map_err(|_| at(Problem::TooShort { found }))?;
        if prefix.version != wire::FORMAT_VERSION {
            let found = prefix.version;
            return Err(at(Problem::Version { found }));
        }
        if prefix.total_bytes as usize != found {
            let declared = prefix.total_bytes;
            return Err(at(Problem::Length { declared, found }));
        }
        if found > MAX_LIBRARY_BYTES {
            return Err(at(Problem::TooLarge { found }));
        }
        let mut digest = wire::CRC32.digest();
        digest.update(&self.bytes[..CRC_RANGE.start]);
        Ok(Stage::Checksum {
            stored: prefix.crc32,
            at: CRC_RANGE.end,
            digest,
        })
    }

    /// Takes up some bytes of the checksum, and after the last of them the number of textures.
    fn checksum(
        &mut self,
        stored: u32,
        at: usize,
        mut digest: crc::Digest<'static, u32>,
    ) -> Result<Stage<'a>, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Library);
        let end = self.bytes.len().min(at + STEP_BYTES);
        digest.update(&self.bytes[at..end]);
        if end < self.bytes.len() {
            let at = end;
            return Ok(Stage::Checksum { stored, at, digest });
        }
        let computed = digest.finalize();
        if stored != computed {
            return Err(here(Problem::Checksum { stored, computed }));
        }
        if self.bytes[wire::RESERVED] != [0; 2] {
            return Err(here(Problem::Reserved));
        }
        let found = self.bytes.len();
        self.rest = Reader(&self.bytes[wire::PREFIX_BYTES..]);
        let count = self
            .rest
            .varint()
            .ok_or(here(Problem::TooShort { found }))?;
        let len = count as usize;
        if len == 0 || len > MAX_TEXTURES {
            return Err(here(Problem::TextureCount(len)));
        }
        (self.library.textures, self.library.len) = (self.rest.0, len);
        Ok(Stage::Texture)
    }

    fn texture(&mut self) -> Result<Stage<'a>, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Library);
        let index = self.textures;
        if index == self.library.len {
            let count = self.rest.byte().ok_or(here(Problem::NoSceneCount))?;
            let count = usize::from(count);
            if count > MAX_SCENES {
                return Err(here(Problem::SceneCount(count)));
            }
            (self.library.scenes, self.library.scene_count) = (self.rest.0, count);
            return Ok(Stage::Scene);
        }
        let here = |problem: Problem| problem.at(Place::Texture(index));
        let record = self.rest.string().ok_or(here(Problem::Malformed))?;
        let texture = Texture::parse(record, index)?;
        check_header(&texture, index)?;
        let inserted = self.texture_names.insert(texture.name.as_bytes());
        inserted.map_err(|other| here(Problem::NameTaken(other)))?;
        // No scene is checked before the nodes, which the summary was not compared with yet.
        self.bounds[index] = TextureBounds::of(&texture);
        self.textures += 1;
        Ok(Stage::Nodes(NodesCheck::new(texture, index)))
    }

    fn scene(&mut self) -> Result<(), DecodeError> {
        let here = |problem: Problem| problem.at(Place::Scene(self.scenes));
        let malformed = || here(Problem::MalformedScene);
        let record = self.rest.string().ok_or_else(malformed)?;
        let scene = Scene::parse(record).ok_or_else(malformed)?;
        let bounds = self.bounds.get(..self.library.len).unwrap_or_default();
        scene
            .validate_with(self.library.len, |_, texture| bounds.get(texture).copied())
            .map_err(|error| here(error.into()))?;
        let name = Scene::name_of(record).ok_or_else(malformed)?;
        let inserted = self.scene_names.insert(name);
        inserted.map_err(|other| here(Problem::SceneNameTaken(other)))?;
        self.scenes += 1;
        Ok(())
    }

    fn end(&self) -> Result<Library<'a>, DecodeError> {
        let left = self.rest.0.len();
        if left > 0 {
            return Err(Problem::LeftOver(left).at(Place::Library));
        }
        Ok(self.library)
    }
}

impl<'a> Library<'a> {
    /// Checks `bytes` from the first to the last and returns a view of them, by a [`Decoder`].
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
        let mut decoder = Decoder::demanding(bytes, demand);
        loop {
            if let Some(library) = decoder.step()? {
                return Ok(library);
            }
        }
    }
}
