//! Why a scene cannot be played, and where.

use core::fmt;

use super::limits;
use crate::limits::{MAX_NAME_BYTES, MAX_SAMPLE_RATE_HZ};

/// A scene that the stylus cannot play.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct SceneError {
    /// Where the fault is.
    pub place: ScenePlace,
    /// What it is.
    pub problem: SceneProblem,
}

/// A place in a scene. Surfaces, regions and sections are counted from 0, as a library does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenePlace {
    /// The scene as such.
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

/// What is wrong with a scene.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneProblem {
    /// A name that is empty.
    #[error("the name is empty; there must be 1 to {MAX_NAME_BYTES} bytes")]
    NameLength,
    /// A name with characters that cannot be typed or shown.
    #[error("a name with a control character")]
    NameCharacter,
    /// A sample rate of zero, or too high.
    #[error("a sample rate of {0} Hz; there must be 1 to {MAX_SAMPLE_RATE_HZ}")]
    SampleRate(u32),
    /// No surface.
    #[error("no surface; there must be 1 to {}", limits::MAX_SURFACES)]
    NoSurface,
    /// A number that is not finite or out of its range.
    #[error("{field} is {value} {unit}; it must be finite and {lowest} to {highest}")]
    Range {
        /// The field, as it is called in [`super::Scene`] but for its unit.
        field: &'static str,
        /// What it is.
        value: f32,
        /// The lowest it may be.
        lowest: f32,
        /// The highest it may be.
        highest: f32,
        /// Its unit, or nothing.
        unit: &'static str,
    },
    /// A region that ends where it begins, or before.
    #[error("it ends at {end_mm} mm, which is not beyond its beginning at {start_mm} mm")]
    RegionEnd {
        /// Where it begins, mm.
        start_mm: f32,
        /// Where it ends, mm.
        end_mm: f32,
    },
    /// A region that begins before the one before it ends.
    #[error("it begins at {start_mm} mm, before region {before} ends at {end_mm} mm")]
    RegionOverlap {
        /// Where it begins, mm.
        start_mm: f32,
        /// The region before.
        before: usize,
        /// Where that ends, mm.
        end_mm: f32,
    },
    /// A surface that there is not.
    #[error("surface {surface} is not there: the scene has {count}")]
    UnknownSurface {
        /// Which was asked for.
        surface: u8,
        /// How many there are.
        count: usize,
    },
    /// A texture that the library does not have.
    #[error("texture {texture} is not there: the library has {count}")]
    UnknownTexture {
        /// Which was asked for.
        texture: u8,
        /// How many there are.
        count: usize,
    },
    /// A texture of another sample rate.
    #[error("its texture is for {texture_hz} Hz and the scene for {scene_hz} Hz")]
    TextureRate {
        /// The texture's.
        texture_hz: u32,
        /// The scene's.
        scene_hz: u32,
    },
    /// A gain above 1 that leaves its texture too little room.
    #[error(
        "a gain of {gain} makes its texture too loud; the highest for this texture is {highest}"
    )]
    TooLoud {
        /// The gain.
        gain: f32,
        /// The highest that this texture bears.
        highest: f32,
    },
    /// Stick-slip without a texture to which it could happen.
    #[error("stick-slip modulates a texture, and the surface has none")]
    NothingToModulate,
    /// A pole beyond the limit.
    #[error(
        "a pole lies beyond a radius of {}/1024",
        limits::MAX_POLE_RADIUS_1024THS
    )]
    PoleRadius,
    /// A section or the sections up to it with too much gain.
    #[error(
        "this section, or all up to it, have a gain above {}",
        limits::MAX_EQUALISER_GAIN
    )]
    EqualiserGain,
}

impl SceneProblem {
    pub(crate) const fn at(self, place: ScenePlace) -> SceneError {
        SceneError {
            place,
            problem: self,
        }
    }
}
