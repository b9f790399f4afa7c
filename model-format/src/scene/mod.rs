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
