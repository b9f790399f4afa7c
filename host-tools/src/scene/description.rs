//! What a scene's text says, before anything is looked up. Its ranges are those of [`model_format::scene`].

use std::path::PathBuf;

use serde::Deserialize;

use super::equaliser::SectionKind;
use crate::dsp::MODEL_RATE_HZ;

/// A scene's content.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneDescription {
    /// Its name, unique in its library.
    pub name: String,
    /// Samples a second, Hz; that of the models if not given.
    #[serde(default = "model_rate_hz")]
    pub sample_rate_hz: u32,
    /// Width of the transition between neighbouring regions, mm; none if not given.
    #[serde(default)]
    pub transition_mm: f32,
    /// The motion that the textures follow; unnamed, the stylus's own.
    pub constant_motion: Option<ConstantMotion>,
    /// The surfaces.
    #[serde(default, rename = "surface")]
    pub surfaces: Vec<SurfaceDescription>,
    /// Where they lie, in any order; none is the first surface everywhere.
    #[serde(default, rename = "region")]
    pub regions: Vec<RegionDescription>,
    /// What undoes the actuator's own response; unnamed, nothing.
    pub equaliser: Option<EqualiserDescription>,
}

const fn model_rate_hz() -> u32 {
    MODEL_RATE_HZ
}

/// A motion that does not change.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantMotion {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f32,
    /// Normal force, N.
    pub force_n: f32,
}

/// Something to be touched.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceDescription {
    /// What regions call it; the texture's name if not given.
    pub name: Option<String>,
    /// Name of its texture in the library; unnamed, the surface is smooth.
    pub texture: Option<String>,
    /// Gain of the texture.
    #[serde(default = "unity")]
    pub gain: f32,
    /// What it answers to an impact; unnamed, nothing.
    pub tap: Option<TapDescription>,
    /// How the tool sticks to it and slips; unnamed, it does not.
    pub stick_slip: Option<StickSlipDescription>,
}

const fn unity() -> f32 {
    1.0
}

impl SurfaceDescription {
    /// What regions call it.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref().or(self.texture.as_deref())
    }
}

/// A tap transient; see [`model_format::scene::Tap`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TapDescription {
    /// Frequency, Hz.
    pub frequency_hz: f32,
    /// Time constant of the decay, s.
    pub decay_s: f32,
    /// Amplitude for a rate of force at contact, m/s² per N/s.
    pub gain_m_s2_per_n_s: f32,
    /// Largest amplitude, m/s².
    pub limit_m_s2: f32,
}

/// Stick-slip; see [`model_format::scene::StickSlip`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StickSlipDescription {
    /// Path from one slip to the next, mm.
    pub period_mm: f32,
    /// Share of the period that the slip takes, 0 to 1.
    pub duty: f32,
    /// By how much the texture is weaker while the tool sticks, 0 to 1.
    pub depth: f32,
    /// Speed from which on the tool slides, mm/s.
    pub below_mm_s: f32,
    /// Force up to which the tool slides, N.
    pub above_n: f32,
}

/// A stretch of the path.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionDescription {
    /// Name of its surface in the scene.
    pub surface: String,
    /// Where it begins, mm.
    pub start_mm: f32,
    /// Where it ends, mm.
    pub end_mm: f32,
}

/// The equaliser: a response to undo, or sections as they are.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EqualiserDescription {
    /// The actuator's response, a file beside the scene's.
    pub response: Option<PathBuf>,
    /// Most gain at any frequency, dB.
    pub max_gain_db: Option<f64>,
    /// Most sections for the response.
    pub max_sections: Option<usize>,
    /// Where the response begins to be undone, Hz; its lowest frequency if not given.
    pub lowest_hz: Option<f64>,
    /// Up to where it is undone, Hz; its highest frequency, or what the sample rate allows, if not given.
    pub highest_hz: Option<f64>,
    /// Sections, one after the other.
    #[serde(default, rename = "section")]
    pub sections: Vec<SectionDescription>,
}

/// A section of the equaliser.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionDescription {
    /// What it does around its frequency.
    pub kind: SectionKind,
    /// Its frequency, Hz.
    pub frequency_hz: f64,
    /// Its quality factor Q.
    pub q: f64,
    /// Its gain, dB.
    pub gain_db: f64,
}
