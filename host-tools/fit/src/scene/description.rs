//! The content of a scene's text, with names instead of indices. The ranges of the values are in
//! [`model_format::scene`].

use std::path::{Path, PathBuf};

use model_format::SAMPLE_RATE_HZ;
use serde::Deserialize;
use stylus_dsp::equaliser::SectionKind;
use stylus_support::bounded_file::Format;
use stylus_support::toml_field::{Field, from_toml};
use stylus_support::{Error, Result};

/// A scene's content.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneDescription {
    /// Name of the scene, unique in its library.
    pub name: String,
    /// Sample rate, Hz; 5000 if not given.
    #[serde(default = "model_rate_hz")]
    pub sample_rate_hz: u32,
    /// Width of the transition between neighbouring regions, mm; 0 if not given.
    #[serde(default)]
    pub transition_mm: f32,
    /// Motion that the textures follow; if not given, they follow the stylus's own motion.
    pub constant_motion: Option<ConstantMotion>,
    /// The surfaces.
    #[serde(default, rename = "surface")]
    pub surfaces: Vec<SurfaceDescription>,
    /// Regions of the path in any order; without any, the first surface covers the whole path.
    #[serde(default, rename = "region")]
    pub regions: Vec<RegionDescription>,
    /// Equaliser of everything that the scene plays; none if not given.
    pub equaliser: Option<EqualiserDescription>,
}

const fn model_rate_hz() -> u32 {
    SAMPLE_RATE_HZ
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

/// A surface to be touched.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceDescription {
    /// Name by which regions refer to the surface; the texture's name if not given.
    pub name: Option<String>,
    /// Name of its texture in the library; the surface is smooth if not given.
    pub texture: Option<String>,
    /// Gain of the texture.
    #[serde(default = "unity")]
    pub gain: f32,
    /// Response to an impact; none if not given.
    pub tap: Option<TapDescription>,
    /// Sticking and slipping of the tool; none if not given.
    pub stick_slip: Option<StickSlipDescription>,
}

const fn unity() -> f32 {
    1.0
}

impl SurfaceDescription {
    /// Returns the name by which regions refer to the surface.
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
    /// Amplitude per rate of force at contact, m/s² per N/s.
    pub gain_m_s2_per_n_s: f32,
    /// Largest amplitude, m/s².
    pub limit_m_s2: f32,
}

/// Stick-slip; see [`model_format::scene::StickSlip`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StickSlipDescription {
    /// Distance from one slip to the next, mm.
    pub period_mm: f32,
    /// Fraction of the period that the slip takes, 0 to 1.
    pub duty: f32,
    /// Fraction by which the texture is weaker while the tool sticks, 0 to 1.
    pub depth: f32,
    /// Speed below which the tool sticks, mm/s.
    pub below_mm_s: f32,
    /// Force above which the tool sticks, N.
    pub above_n: f32,
}

/// A stretch of the path.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionDescription {
    /// Name of its surface in the scene.
    pub surface: String,
    /// Start, mm.
    pub start_mm: f32,
    /// End, mm.
    pub end_mm: f32,
}

/// The equaliser, as its sections.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EqualiserDescription {
    /// Sections of the cascade, in order.
    #[serde(default, rename = "section")]
    pub sections: Vec<SectionDescription>,
}

/// A section of the equaliser.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionDescription {
    /// Kind of filter: its effect around the frequency.
    pub kind: SectionKind,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Quality factor Q.
    pub q: f64,
    /// Gain, dB.
    pub gain_db: f64,
}

/// The text of a scene with its description. No name is looked up in a library before [`SceneFile::compile`].
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    pub(super) path: PathBuf,
    pub(super) text: String,
    pub(super) description: SceneDescription,
}

impl SceneFile {
    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self> {
        let text = Format::Scene.read_text(path)?;
        Self::from_toml(path, &text)
    }

    /// Reads a scene from TOML `text`; `path` is only named in errors.
    ///
    /// # Errors
    /// [`Error::Line`]: text that is not TOML, a key that is unknown, missing, or of the wrong type.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            text: text.to_owned(),
            description: from_toml(path, text)?,
        })
    }

    /// Returns an error at `place` of the text.
    pub(super) fn error(&self, place: &Field, problem: impl std::fmt::Display) -> Error {
        place.error(&self.path, &self.text, problem)
    }
}
