//! Scenes: textures along the stylus's path, and the effects that go with them.
//!
//! A scene has a bounded size and needs no allocation. Postcard encodes it directly. In a library, scenes stand after
//! the textures that they refer to. [`Scene::validate`] is the only check, on the host and on the device; a scene that
//! passes it can be compiled to a plan and played.
//!
//! **Regions** lie one after the other along the path, in mm. Between regions nothing sounds. In a scene without
//! regions, the first surface is everywhere. Where two regions touch, one surface fades into the other at equal power;
//! this transition is centred on the boundary. Where a region has no neighbour, its surface fades within the region
//! over half the transition's width. A region shorter than the transition's width shortens the transitions at its ends
//! to its own length.
//!
//! [`SceneError`] says why a scene cannot be played, and where.

mod equaliser;
mod read;
mod validate;

use core::fmt;

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::decimal::Decimal;
use crate::limits::{MAX_NAME_BYTES, MAX_SAMPLE_RATE_HZ};

pub(crate) use equaliser::GainCheck;
pub(crate) use validate::TextureBounds;

pub use equaliser::{Biquad, check as check_equaliser};

/// Bounds that every scene keeps.
pub mod limits {
    /// Largest number of scenes in a library.
    pub const MAX_SCENES: usize = 32;

    /// Largest number of surfaces in a scene.
    pub const MAX_SURFACES: usize = 16;

    /// Largest number of regions in a scene.
    pub const MAX_REGIONS: usize = 32;

    /// Largest number of sections of an equaliser.
    pub const MAX_SECTIONS: usize = 8;

    /// Largest number of sections of the response's equaliser in the device. They follow the sections of a scene.
    pub const MAX_RESPONSE_SECTIONS: usize = 6;

    /// Largest distance of a position from the path's origin, in either direction, mm. At 100 m, a step of `f32` is
    /// still 8 µm.
    pub const MAX_POSITION_MM: f32 = 100_000.0;

    /// Widest transition, mm.
    pub const MAX_TRANSITION_MM: f32 = 100.0;

    /// Largest gain of a texture. A gain above 1 must leave the texture's loudest node at most half the highest RMS
    /// that a library's node may have.
    pub const MAX_GAIN: f32 = 64.0;

    /// Highest constant speed, mm/s.
    pub const MAX_SPEED_MM_S: f32 = 10_000.0;

    /// Highest constant force, N.
    pub const MAX_FORCE_N: f32 = 1000.0;

    /// Lowest frequency of a tap transient, Hz.
    pub const MIN_TAP_HZ: f32 = 10.0;

    /// Highest frequency of a tap transient, as a fraction of the sample rate.
    pub const MAX_TAP_SHARE_OF_RATE: f32 = 0.45;

    /// Shortest and longest time constant of a tap transient, s.
    pub const TAP_DECAY_S: [f32; 2] = [0.000_5, 1.0];

    /// Largest gain of a tap transient, m/s² per N/s.
    pub const MAX_TAP_GAIN: f32 = 100.0;

    /// Largest amplitude of a tap transient, m/s²: an eighth of the output's full scale.
    pub const MAX_TAP_M_S2: f32 = 256.0;

    /// Shortest and longest period of stick-slip, mm.
    pub const STICK_SLIP_PERIOD_MM: [f32; 2] = [0.01, 1000.0];

    /// Smallest and largest fraction of a period that a slip takes.
    pub const STICK_SLIP_DUTY: [f32; 2] = [0.05, 1.0];

    /// Lowest threshold of stick-slip, of speed in mm/s and of force in N.
    pub const MIN_STICK_SLIP_THRESHOLD: f32 = 0.001;

    /// Largest radius of a pole of an equaliser's section, in 1024ths: 1023/1024 corresponds to a time constant of 1023
    /// samples, 0.2 s at 5 kHz.
    pub const MAX_POLE_RADIUS_1024THS: i64 = 1023;

    /// Largest gain at any frequency, 24 dB: of each section of an equaliser, and of the sections from the first up to
    /// each.
    pub const MAX_EQUALISER_GAIN: f64 = 16.0;
}

/// Name of a scene.
pub type SceneName = String<MAX_NAME_BYTES>;

/// Surfaces along a path, and how they are played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Name, unique among its library's scenes.
    pub name: SceneName,
    /// Sample rate of the scene's output, Hz. All its textures must have this rate, and the equaliser is designed for
    /// it.
    pub sample_rate_hz: u32,
    /// Surfaces, at least one.
    pub surfaces: Vec<Surface, { limits::MAX_SURFACES }>,
    /// Regions of the surfaces, ascending along the path and without overlap; empty if the first surface is everywhere.
    pub regions: Vec<Region, { limits::MAX_REGIONS }>,
    /// Width of the transition between neighbouring regions, mm.
    pub transition_mm: f32,
    /// Speed and force that the textures follow.
    pub motion: MotionOfScene,
    /// Equaliser of the scene's whole output, as a cascade of sections. Without sections, the output is unchanged.
    pub equaliser: Vec<Biquad, { limits::MAX_SECTIONS }>,
}

/// A surface: a texture, and its response to taps and to slow, heavy motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Index of the surface's texture in the library; none for a smooth surface.
    pub texture: Option<u8>,
    /// Gain of the texture; 0 silences it. Tap transients have a gain of their own.
    pub gain: f32,
    /// Response to an impact.
    pub tap: Option<Tap>,
    /// Stick-slip of the tool on the surface.
    pub stick_slip: Option<StickSlip>,
}

/// A stretch of the path with one surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Beginning of the region along the path, mm.
    pub start_mm: f32,
    /// End of the region along the path, mm.
    pub end_mm: f32,
    /// Index of the region's surface in the scene.
    pub surface: u8,
}

/// Speed and force that the textures follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum MotionOfScene {
    /// The current speed and force.
    Followed,
    /// The same speed and force for as long as there is contact, so that no coefficient changes.
    Constant {
        /// Tangential speed, mm/s.
        speed_mm_s: f32,
        /// Normal force, N.
        force_n: f32,
    },
}

/// A tap transient: on contact, `a · exp(-t/τ) · sin(2πft)`, where the amplitude a is the gain times the rate of force.
///
/// Okamura, Cutkosky and Dennerlein, *Reality-based models for vibration feedback in virtual environments*, IEEE/ASME
/// Trans. Mechatronics 6(3), 2001, scale the same model by the speed of impact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tap {
    /// Frequency f, Hz.
    pub frequency_hz: f32,
    /// Time constant τ of the decay, s.
    pub decay_s: f32,
    /// Amplitude per rate of force at contact, m/s² per N/s.
    pub gain_m_s2_per_n_s: f32,
    /// Largest amplitude, m/s², however hard or often the tool strikes.
    pub limit_m_s2: f32,
}

/// Stick-slip: below a speed and above a force the texture comes in bursts, one per period of the path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StickSlip {
    /// Path from one slip to the next, mm.
    pub period_mm: f32,
    /// Fraction of the period that the slip takes, 0.05 to 1.
    pub duty: f32,
    /// Attenuation of the texture while the tool sticks: 0 is none, 1 is silence.
    pub depth: f32,
    /// Speed at and above which the tool slides, mm/s. Below this speed, sticking begins; it is complete at three
    /// quarters of the speed.
    pub below_mm_s: f32,
    /// Force up to which the tool slides, N. Above this force, sticking begins; it is complete at five quarters of the
    /// force.
    pub above_n: f32,
}

impl Scene {
    /// Creates a scene that has `surface` everywhere and follows the motion, without a transition or an equaliser.
    pub fn of_surface(name: SceneName, sample_rate_hz: u32, surface: Surface) -> Self {
        let mut surfaces = Vec::new();
        // A list of surfaces has a capacity of more than one.
        let _ = surfaces.push(surface);
        Self {
            name,
            sample_rate_hz,
            surfaces,
            regions: Vec::new(),
            transition_mm: 0.0,
            motion: MotionOfScene::Followed,
            equaliser: Vec::new(),
        }
    }
}

impl Surface {
    /// Creates a surface with texture number `texture` of the library, at a gain of 1 and without effects.
    pub const fn of_texture(texture: u8) -> Self {
        Self {
            texture: Some(texture),
            gain: 1.0,
            tap: None,
            stick_slip: None,
        }
    }
}

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
        /// Name of the field in [`Scene`], without its unit.
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
