//! Scenes: textures along the stylus's path, and the effects that go with them.
//!
//! A scene is owned and bounded: it takes no allocation, postcard encodes it as it is, and it stands in a library
//! after the textures that it names. [`Scene::validate`] is the one check, on both sides; a scene that passes it can be
//! compiled to a plan and played.
//!
//! **Regions** lie along the path, in mm, one after the other. Between regions nothing sounds. A scene without regions
//! is its first surface everywhere. Where two regions touch, one surface fades into the other over the transition's
//! width, centred on the boundary, at equal power. Where a region has no neighbour, it fades within itself over half
//! that width. A region shorter than the width shortens the transitions at its ends to its own length.

mod equaliser;
mod error;
pub mod limits;
mod read;
mod validate;

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

pub(crate) use equaliser::GainCheck;
pub use equaliser::{Biquad, check as check_equaliser};
pub use error::{SceneError, ScenePlace, SceneProblem};

use crate::limits::MAX_NAME_BYTES;

pub(crate) use validate::TextureBounds;

/// Name of a scene.
pub type SceneName = String<MAX_NAME_BYTES>;

/// Surfaces along a path, and how they are played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Name, unique among its library's scenes.
    pub name: SceneName,
    /// Sample rate of all textures in the scene, for which the equaliser was designed too, Hz.
    pub sample_rate_hz: u32,
    /// Surfaces, at least one.
    pub surfaces: Vec<Surface, { limits::MAX_SURFACES }>,
    /// Regions of the surfaces, ascending along the path and without overlap; empty if the first surface is everywhere.
    pub regions: Vec<Region, { limits::MAX_REGIONS }>,
    /// Width of the transition between neighbouring regions, mm.
    pub transition_mm: f32,
    /// Speed and force that the textures follow.
    pub motion: MotionOfScene,
    /// Equaliser of all that is played, as a cascade of sections; none leaves the output as it is.
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
    /// Speed and force of the moment.
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
    /// Share of the period that the slip takes, 0 to 1.
    pub duty: f32,
    /// Attenuation of the texture while the tool sticks: 0 is none, 1 is silence.
    pub depth: f32,
    /// Speed at and above which the tool slides, mm/s. Sticking sets in below it and is full at three quarters of it.
    pub below_mm_s: f32,
    /// Force up to which the tool slides, N. Sticking sets in above it and is full at five quarters of it.
    pub above_n: f32,
}

impl Scene {
    /// A scene of `surface` everywhere that follows the motion, without a transition or an equaliser.
    pub fn of_surface(name: SceneName, sample_rate_hz: u32, surface: Surface) -> Self {
        let mut surfaces = Vec::new();
        // There is room for one.
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
    /// The surface of texture number `texture` of the library, at its own level and without effects.
    pub const fn of_texture(texture: u8) -> Self {
        Self {
            texture: Some(texture),
            gain: 1.0,
            tap: None,
            stick_slip: None,
        }
    }
}
