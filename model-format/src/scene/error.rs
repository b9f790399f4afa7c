//! Faults of scenes that cannot be played, each with its place.

use core::fmt;

use super::limits;
use crate::decimal::Decimal;
use crate::limits::{MAX_NAME_BYTES, MAX_SAMPLE_RATE_HZ};

/// The first fault found in a scene that the stylus cannot play.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct SceneError {
    /// Place of the fault.
    pub place: ScenePlace,
    /// The fault.
    pub problem: SceneProblem,
}

/// A place in a scene. Surfaces, regions and sections are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenePlace {
    /// The whole scene.
    Scene,
    /// A surface.
    Surface(usize),
    /// A surface's tap transient.
    Tap(usize),
    /// A surface's stick-slip.
    StickSlip(usize),
    /// A region.
    Region(usize),
    /// The constant motion.
    Motion,
    /// A section of the equaliser.
    Section(usize),
}

impl fmt::Display for ScenePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Scene => f.write_str("scene"),
            Self::Surface(surface) => write!(f, "surface {surface}"),
            Self::Tap(surface) => write!(f, "surface {surface}, tap"),
            Self::StickSlip(surface) => write!(f, "surface {surface}, stick-slip"),
            Self::Region(region) => write!(f, "region {region}"),
            Self::Motion => f.write_str("constant motion"),
            Self::Section(section) => write!(f, "equaliser, section {section}"),
        }
    }
}

/// A fault of a scene.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each message says it")]
pub enum SceneProblem {
    #[error("the name is empty; there must be 1 to {MAX_NAME_BYTES} bytes")]
    NameLength,
    #[error("a name with a control character")]
    NameCharacter,
    #[error("a sample rate of {0} Hz; there must be 1 to {MAX_SAMPLE_RATE_HZ}")]
    SampleRate(u32),
    #[error("no surface; there must be 1 to {}", limits::MAX_SURFACES)]
    NoSurface,
    #[error(
        "{field} is {value} {unit}; it must be finite and {lowest} to {highest}",
        value = Decimal(*.value),
        lowest = Decimal(*.lowest),
        highest = Decimal(*.highest)
    )]
    Range {
        /// Name of the field in [`super::Scene`], without its unit.
        field: &'static str,
        value: f32,
        /// The lowest value of the field.
        lowest: f32,
        /// The highest value of the field.
        highest: f32,
        /// Unit of the field; empty for a number without one.
        unit: &'static str,
    },
    #[error(
        "it ends at {end_mm} mm, which is not beyond its beginning at {start_mm} mm",
        end_mm = Decimal(*.end_mm),
        start_mm = Decimal(*.start_mm)
    )]
    RegionEnd {
        /// Beginning of the region, mm.
        start_mm: f32,
        /// End of the region, mm.
        end_mm: f32,
    },
    #[error(
        "it begins at {start_mm} mm, before region {before} ends at {end_mm} mm",
        start_mm = Decimal(*.start_mm),
        end_mm = Decimal(*.end_mm)
    )]
    RegionOverlap {
        /// Beginning of the region, mm.
        start_mm: f32,
        /// Index of the region before.
        before: usize,
        /// End of the region before, mm.
        end_mm: f32,
    },
    #[error("surface {surface} is not there: the scene has {count}")]
    UnknownSurface {
        /// Index of the surface.
        surface: u8,
        /// Number of surfaces.
        count: usize,
    },
    #[error("texture {texture} is not there: the library has {count}")]
    UnknownTexture {
        /// Index of the texture.
        texture: u8,
        /// Number of textures.
        count: usize,
    },
    #[error("its texture is for {texture_hz} Hz and the scene for {scene_hz} Hz")]
    TextureRate {
        /// Sample rate of the texture, Hz.
        texture_hz: u32,
        /// Sample rate of the scene, Hz.
        scene_hz: u32,
    },
    #[error(
        "a gain of {gain} makes its texture too loud; the highest for this texture is {highest}",
        gain = Decimal(*.gain),
        highest = Decimal(*.highest)
    )]
    TooLoud {
        gain: f32,
        /// The highest gain for this texture.
        highest: f32,
    },
    #[error("stick-slip modulates a texture, and the surface has none")]
    NothingToModulate,
    #[error("a pole lies beyond a radius of {}/1024", limits::MAX_POLE_RADIUS_1024THS)]
    PoleRadius,
    #[error(
        "this section, or all up to it, have a gain above {}",
        Decimal(limits::MAX_EQUALISER_GAIN as f32)
    )]
    EqualiserGain,
}

impl SceneProblem {
    pub(crate) const fn at(self, place: ScenePlace) -> SceneError {
        SceneError { place, problem: self }
    }
}
