//! What a rig file says: the rig, the strips on its drum, the trials and what measuring adds. Plain values, as they are in
//! the TOML text; [`validate`](super::validate) checks their ranges, and a [`RigFile`](super::RigFile) has been checked.

use serde::Deserialize;

/// A rig, what is on its drum, and the trials to record.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigDescription {
    /// Its name, for the outputs.
    pub name: String,
    /// The trials to record.
    pub recording: Recording,
    /// The drum.
    pub drum: Drum,
    /// The tool and the hand that holds it; required once a texture has a profile.
    pub tool: Option<Tool>,
    /// The textures, each in a sub-folder of its name.
    #[serde(rename = "texture")]
    pub textures: Vec<Texture>,
    /// What measuring adds; unnamed, nothing.
    #[serde(default)]
    pub measurement: Measurement,
}

/// The trials: every texture at every speed and force.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Sample rate, Hz; a whole number, as WAV stores it.
    pub sample_rate_hz: u32,
    /// Length of a trial, s.
    pub duration_s: f64,
    /// Surface speeds of the drum, mm/s, ascending.
    pub speeds_mm_s: Vec<f64>,
    /// Normal forces, N, ascending; at 0 there is no contact.
    pub forces_n: Vec<f64>,
}

impl Recording {
    /// Samples of one trial on each axis.
    pub fn samples(&self) -> usize {
        (self.duration_s * f64::from(self.sample_rate_hz)).round() as usize
    }
}

/// The rotating drum.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drum {
    /// Circumference, mm: the period of every profile.
    pub circumference_mm: f64,
}

/// The tool, held in a hand.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tool {
    /// Radius of the hemispherical tip, mm.
    pub tip_radius_mm: f64,
    /// Resonances of tool and hand.
    #[serde(rename = "mode")]
    pub modes: Vec<Mode>,
}

/// One resonance.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Undamped natural frequency, Hz.
    pub frequency_hz: f64,
    /// Fraction of critical damping.
    pub damping_ratio: f64,
    /// Acceleration at the accelerometer well above resonance for a normal force at the tip, (m/s²)/N, on x, y, z.
    pub participation_m_s2_per_n: [f64; 3],
    /// The same for the tip itself, along the normal, (m/s²)/N: one over the modal mass felt at the tip. Unnamed, the
    /// tip does not give way in this mode.
    pub tip_participation_m_s2_per_n: Option<f64>,
}

/// One strip on the drum.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Texture {
    /// Its name, and that of its sub-folder.
    pub name: String,
    /// Effective Hertz modulus E* of tip and surface, MPa.
    pub effective_modulus_mpa: f64,
    /// Loss factor η of the contact; unnamed, the contact is lossless.
    pub loss_factor: Option<f64>,
    /// Periodic parts of the profile.
    #[serde(default, rename = "weave")]
    pub weaves: Vec<Weave>,
    /// Random part of the profile.
    pub roughness: Option<Roughness>,
}

impl Texture {
    /// Whether the surface has any height at all.
    pub fn has_profile(&self) -> bool {
        !self.weaves.is_empty() || self.roughness.is_some()
    }
}

/// A periodic part of a profile: a line at speed / wavelength and its harmonics.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weave {
    /// Wavelength along the track, mm.
    pub wavelength_mm: f64,
    /// Amplitude (half of peak to peak) of the fundamental, µm.
    pub amplitude_um: f64,
    /// Amplitudes of the second, third ... harmonic as fractions of the fundamental's; may be negative.
    #[serde(default)]
    pub harmonics: Vec<f64>,
    /// How the spacing wanders; unnamed, it is exact.
    pub jitter: Option<Jitter>,
}

/// Random wandering of a weave's phase.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jitter {
    /// RMS phase of the fundamental, rad.
    pub rms_rad: f64,
    /// Distance over which the phase stays correlated (to e^{-1/2}), mm.
    pub correlation_mm: f64,
}

/// A self-affine Gaussian profile.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roughness {
    /// RMS height over all wavelengths, µm.
    pub rms_um: f64,
    /// Hurst exponent, over 0 up to 1: larger is smoother.
    pub hurst: f64,
    /// Wavelength above which the spectrum is flat, mm.
    pub roll_off_mm: f64,
    /// Wavelength below which there is nothing, mm.
    pub shortest_mm: f64,
}

/// What measuring adds, each effect only if named.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// The hand's tremor.
    pub tremor: Option<Tremor>,
    /// Hum of the mains.
    pub hum: Option<Hum>,
    /// Constant error of the sensor.
    pub offset: Option<Offset>,
    /// White noise of the sensor.
    pub noise: Option<Noise>,
    /// Limits of the sensor.
    pub clipping: Option<Clipping>,
}

/// Physiological tremor: Gaussian, its power even over a narrow band, along one fixed direction.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tremor {
    /// Lower edge of the band, Hz.
    pub lowest_hz: f64,
    /// Upper edge of the band, Hz.
    pub highest_hz: f64,
    /// RMS acceleration on x, y, z, m/s².
    pub rms_m_s2: [f64; 3],
}

/// A sine from the mains, its phase drawn for each trial.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hum {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude on x, y, z, m/s²; may be negative.
    pub amplitude_m_s2: [f64; 3],
}

/// A constant added to every sample.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Offset {
    /// On x, y, z, m/s².
    pub value_m_s2: [f64; 3],
}

/// White Gaussian noise, independent between axes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// RMS over the whole band on x, y, z, m/s².
    pub rms_m_s2: [f64; 3],
}

/// A range beyond which values are cut off.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clipping {
    /// Largest magnitude, in standard gravities; 5 if not given, as the paper's accelerometer has.
    #[serde(default = "Clipping::paper_range_g")]
    pub range_g: f64,
}

impl Clipping {
    fn paper_range_g() -> f64 {
        5.0
    }

    /// The range in m/s².
    pub fn range_m_s2(&self) -> f64 {
        self.range_g * STANDARD_GRAVITY_M_S2
    }
}

/// Standard gravity, m/s² (exact by definition, CGPM 1901).
const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;
