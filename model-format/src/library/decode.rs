//! Decoding of bytes to a [`Library`], or to the first fault and its place.
//!
//! [`Decoder`] decodes in bounded steps, so that a device can do other work between them. [`Library::decode`] runs all
//! steps in a loop. To add a check, add a variant of [`Stage`] that holds the check's state, and enter it from the
//! stage before it.

use core::borrow::BorrowMut;

use super::Library;
use super::check::{FedCheck, LinesCheck, NodesCheck, check_header};
use super::names::Names;
use super::texture::Texture;
use crate::error::{DecodeError, Place, Problem};
use crate::limits::{MAX_LIBRARY_BYTES, MAX_TEXTURES, STEP_BYTES};
use crate::scene::limits::MAX_SCENES;
use crate::scene::{GainCheck, Scene, SceneError, ScenePlace, TextureBounds};
use crate::wire::{self, CRC_RANGE, Prefix, Reader};

/// Decodes a library in steps. Each step takes a bounded time, see [`crate::limits::STEP_INSTRUCTIONS`].
///
/// ```
/// # use model_format::{CodeSpec, NodeSpec, TextureSpec};
/// use model_format::{Decoder, encode};
/// # let node = NodeSpec::new(4.0, CodeSpec::lattice(vec![-20_000]));
/// # let textures = [TextureSpec::new("denim", &[100.0], &[1.0], vec![node])];
///
/// let bytes = encode(&textures)?;
/// let mut decoder = Decoder::new(&bytes);
/// let library = loop {
///     if let Some(library) = decoder.step()? {
///         break library;
///     }
///     // Other work can be done here.
/// };
/// assert_eq!(library.len(), 1);
/// # Ok::<(), model_format::DecodeError>(())
/// ```
///
/// A decoder from [`Decoder::new`] contains its [`Workspace`], which takes some kilobytes. A decoder from
/// [`Decoder::within`] borrows its workspace.
#[derive(Clone)]
pub struct Decoder<'a, W = Workspace> {
    bytes: &'a [u8],
    stage: Stage<'a>,
    /// The bytes that no stage has read yet.
    rest: Reader<'a>,
    /// The library as far as it was read. Only the last step returns it.
    library: Library<'a>,
    /// Number of textures that were begun; `scenes` is the number of scenes that were begun.
    textures: usize,
    scenes: usize,
    work: W,
}

/// Memory of a [`Decoder`]: the names of textures and scenes that it has read, and properties that later checks need.
#[derive(Clone, Debug)]
pub struct Workspace {
    texture_names: Names<MAX_TEXTURES>,
    scene_names: Names<MAX_SCENES>,
    /// Properties of each texture that the checks of scenes need.
    bounds: [TextureBounds; MAX_TEXTURES],
    /// The check of the gain of the current scene's equaliser.
    gain: Option<GainCheck>,
}

impl Workspace {
    /// Creates a workspace. Any number of decoders can use it, one after the other.
    pub const fn new() -> Self {
        Self {
            texture_names: Names::new(),
            scene_names: Names::new(),
            bounds: [TextureBounds::NONE; MAX_TEXTURES],
            gain: None,
        }
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

/// What the next step checks.
#[derive(Clone)]
enum Stage<'a> {
    /// Prefix: magic, version, length.
    Prefix,
    /// Checksum of the whole library. `digest` covers the bytes before `at` so far, except the stored checksum.
    Checksum {
        stored: u32,
        at: usize,
        digest: crc::Digest<'static, u32>,
    },
    /// Header of the next texture, or the number of scenes.
    Texture,
    /// Lines of a texture, which are tied to position.
    Lines(LinesCheck<'a>),
    /// Nodes of a texture.
    Nodes(NodesCheck<'a>),
    /// Codebooks of a texture.
    Fed(FedCheck<'a>),
    /// The next scene, or the end.
    Scene,
    /// Gain of a scene's equaliser.
    Equaliser,
}

impl<'a> Decoder<'a> {
    /// Creates a decoder of `bytes`, which has not read any of them yet.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self::with(bytes, Workspace::new())
    }
}

impl<'a, 'w> Decoder<'a, &'w mut Workspace> {
    /// Like [`Decoder::new`], with a workspace that the caller owns.
    pub const fn within(bytes: &'a [u8], work: &'w mut Workspace) -> Self {
        Self::with(bytes, work)
    }
}

impl<'a, W> Decoder<'a, W> {
    const fn with(bytes: &'a [u8], work: W) -> Self {
        Self {
            bytes,
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
            work,
        }
    }
}

impl<'a, W: BorrowMut<Workspace>> Decoder<'a, W> {
    /// Runs one step; returns the library after the last one. A call after the last step, or after an error, starts
    /// again.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn step(&mut self) -> Result<Option<Library<'a>>, DecodeError> {
        let stepped = self.step_in_place();
        if !matches!(stepped, Ok(None)) {
            self.stage = Stage::Prefix;
        }
        stepped
    }

    fn step_in_place(&mut self) -> Result<Option<Library<'a>>, DecodeError> {
        match &mut self.stage {
            Stage::Prefix => {
                // A decoder may begin again, and its workspace may come from another one.
                (self.textures, self.scenes) = (0, 0);
                let work = self.work.borrow_mut();
                work.texture_names.clear();
                work.scene_names.clear();
                self.stage = self.prefix()?;
            }
            Stage::Checksum { stored, at, digest } => {
                let end = self.bytes.len().min(*at + STEP_BYTES);
                digest.update(&self.bytes[*at..end]);
                *at = end;
                if end == self.bytes.len() {
                    let (stored, computed) = (*stored, digest.clone().finalize());
                    self.stage = self.body(stored, computed)?;
                }
            }
            Stage::Texture => self.stage = self.texture()?,
            Stage::Lines(lines) => {
                if lines.step()? {
                    let (texture, index) = lines.texture();
                    self.stage = Stage::Nodes(NodesCheck::new(texture, index));
                }
            }
            Stage::Nodes(nodes) => {
                if nodes.step()? {
                    let (texture, index) = nodes.texture();
                    self.stage = FedCheck::new(texture, index).map_or(Stage::Texture, Stage::Fed);
                }
            }
            Stage::Fed(fed) => {
                if fed.step()? {
                    self.stage = Stage::Texture;
                }
            }
            Stage::Scene if self.scenes == self.library.scene_count => return self.end().map(Some),
            Stage::Scene => self.stage = self.scene()?,
            Stage::Equaliser => {
                let gain = self.work.borrow_mut().gain.as_mut();
                let is_checked = gain.map_or(Ok(true), GainCheck::step);
                let is_checked = is_checked.map_err(|(section, problem)| {
                    // The scene was counted when its record was read.
                    let error: SceneError = problem.at(ScenePlace::Section(section));
                    Problem::from(error).at(Place::Scene(self.scenes - 1))
                });
                if is_checked? {
                    self.stage = Stage::Scene;
                }
            }
        }
        Ok(None)
    }

    /// Checks magic, version and length. This comes first, so that the length is known to be right when the checksum is
    /// computed.
    fn prefix(&self) -> Result<Stage<'a>, DecodeError> {
        let at = |problem: Problem| problem.at(Place::Library);
        if !self.bytes.starts_with(&wire::MAGIC) {
            return Err(at(Problem::NotALibrary));
        }
        let found = self.bytes.len();
        let (prefix, _) =
            postcard::take_from_bytes::<Prefix>(self.bytes).map_err(|_| at(Problem::Malformed("its prefix")))?;
        // Before all other rules, which may differ in another version.
        if prefix.version != wire::FORMAT_VERSION {
            let found = prefix.version;
            return Err(at(Problem::Version { found }));
        }
        if prefix.total_bytes as usize != found {
            let declared = prefix.total_bytes;
            return Err(at(Problem::Length { declared, found }));
        }
        // Before the checksum, whose work grows with the length.
        Problem::count("its length in bytes", found, [0, MAX_LIBRARY_BYTES]).map_err(at)?;
        // The checksum covers all bytes but its own four, at which it goes on after this step.
        let mut digest = wire::CRC32.digest();
        digest.update(&self.bytes[..CRC_RANGE.start]);
        Ok(Stage::Checksum {
            stored: prefix.crc32,
            at: CRC_RANGE.end,
            digest,
        })
    }

    /// Compares the checksums, and reads the number of textures, which follows the prefix.
    fn body(&mut self, stored: u32, computed: u32) -> Result<Stage<'a>, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Library);
        if stored != computed {
            return Err(here(Problem::Checksum { stored, computed }));
        }
        if self.bytes[wire::RESERVED] != [0; 2] {
            return Err(here(Problem::Rule("a reserved field is not zero")));
        }
        self.rest = Reader(&self.bytes[wire::PREFIX_BYTES..]);
        let malformed = Problem::Malformed("the number of textures");
        let len = self.rest.varint().ok_or(here(malformed))? as usize;
        Problem::count("the number of textures", len, [1, MAX_TEXTURES]).map_err(here)?;
        (self.library.textures, self.library.len) = (self.rest.0, len);
        Ok(Stage::Texture)
    }

    /// Offset of `record` in the library. `record` must end where `rest` begins.
    fn offset(&self, record: &[u8]) -> u32 {
        (self.bytes.len() - self.rest.0.len() - record.len()) as u32
    }

    fn texture(&mut self) -> Result<Stage<'a>, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Library);
        let index = self.textures;
        if index == self.library.len {
            let malformed = Problem::Malformed("the number of scenes");
            let count = usize::from(self.rest.byte().ok_or(here(malformed))?);
            Problem::count("the number of scenes", count, [0, MAX_SCENES]).map_err(here)?;
            (self.library.scenes, self.library.scene_count) = (self.rest.0, count);
            return Ok(Stage::Scene);
        }
        let here = |problem: Problem| problem.at(Place::Texture(index));
        let record = self.rest.string().ok_or(here(Problem::Malformed("its header")))?;
        let texture = Texture::parse(record, index)?;
        check_header(&texture, index)?;
        // A record begins with its name.
        let offset = self.offset(record);
        let work = self.work.borrow_mut();
        let inserted = work.texture_names.insert(self.bytes, offset);
        inserted.map_err(|other| here(Problem::Taken { what: "name", other }))?;
        // The bounds are taken from the texture's summary. The summary is compared with the nodes before any scene is
        // checked.
        work.bounds[index] = TextureBounds::of(&texture);
        self.textures += 1;
        Ok(match LinesCheck::new(texture, index) {
            Some(lines) => Stage::Lines(lines),
            None => Stage::Nodes(NodesCheck::new(texture, index)),
        })
    }

    fn scene(&mut self) -> Result<Stage<'a>, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Scene(self.scenes));
        let malformed = || here(Problem::Malformed("its record"));
        let record = self.rest.string().ok_or_else(malformed)?;
        let scene = Scene::parse(record).ok_or_else(malformed)?;
        let offset = self.offset(record);
        let work = self.work.borrow_mut();
        let bounds = work.bounds.get(..self.library.len).unwrap_or_default();
        scene
            .validate_with(self.library.len, |_, texture| bounds.get(texture).copied())
            .map_err(|error| here(error.into()))?;
        let inserted = work.scene_names.insert(self.bytes, offset);
        inserted.map_err(|other| here(Problem::Taken { what: "name", other }))?;
        self.scenes += 1;
        Ok(if scene.equaliser.is_empty() {
            Stage::Scene
        } else {
            self.work.borrow_mut().gain = Some(GainCheck::new(&scene.equaliser));
            Stage::Equaliser
        })
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
    /// Checks all of `bytes` by a [`Decoder`], and returns a view of them.
    ///
    /// The work has constant bounds per byte, texture and scene, see [`crate::limits`]. Nothing is copied except
    /// scenes, one at a time.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut decoder = Decoder::new(bytes);
        loop {
            if let Some(library) = decoder.step()? {
                return Ok(library);
            }
        }
    }
}
