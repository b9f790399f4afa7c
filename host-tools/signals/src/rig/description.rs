//! The content of a rig file: the rig, the strips on its drum, the trials, and the effects of measuring.
//!
//! The description contains plain values, as in the TOML text. A [`RigFile`](super::RigFile) contains a description
//! that has been checked.

use serde::Deserialize;

use crate::recording::GRAVITY_M_S2;

/// A rig, the textures on its drum, and the trials to record.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigDescription {
    /// Name of the rig, for the outputs.
    pub name: String,
    /// The trials to record.
    pub recording: Recording,
    /// The drum.
    pub drum: Drum,
    /// The tool and the hand that holds it; required if a texture has a profile.
    pub tool: Option<Tool>,
    /// The textures, each recorded in a subfolder with its name.
    #[serde(rename = "texture")]
    pub textures: Vec<Texture>,
    /// Effects of measuring; none if not given.
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
    /// Normal forces, N, ascending; 0 means no contact.
    pub forces_n: Vec<f64>,
}

impl Recording {
    /// Number of samples of one trial on each axis.
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
    /// Wander of the speed; none if not given.
    pub wander: Option<Wander>,
}

/// Slow random change of a trial's speed about its nominal value, Gaussian.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wander {
    /// RMS of the speed's deviation, as a fraction of the speed.
    pub rms: f64,
    /// Correlation time of the deviation, after which the correlation is e^{-1/2}, s.
    pub correlation_s: f64,
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
    /// Acceleration at the accelerometer, well above resonance, per normal force at the tip, (m/s²)/N, on x, y, z.
    pub participation_m_s2_per_n: [f64; 3],
    /// Acceleration at the tip along the normal, well above resonance, per normal force at the tip, (m/s²)/N. It is the
    /// inverse of the modal mass at the tip. If not given, the tip does not move in this mode.
    pub tip_participation_m_s2_per_n: Option<f64>,
}

/// One strip on the drum.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Texture {
    /// Name of the texture and of its subfolder.
    pub name: String,
    /// Effective Hertz modulus E* of tip and surface, MPa.
    pub effective_modulus_mpa: f64,
    /// Loss factor η of the contact; lossless if not given.
    pub loss_factor: Option<f64>,
    /// Periodic parts of the profile.
    #[serde(default, rename = "weave")]
    pub weaves: Vec<Weave>,
    /// Random part of the profile.
    pub roughness: Option<Roughness>,
}

impl Texture {
    /// Returns true if the surface is not flat.
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
    /// Amplitudes of the second, third ... harmonic as fractions of the fundamental's amplitude; may be negative.
    #[serde(default)]
    pub harmonics: Vec<f64>,
    /// Variation of the spacing; none if not given.
    pub jitter: Option<Jitter>,
}

/// Random variation of a weave's phase.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jitter {
    /// RMS phase of the fundamental, rad.
    pub rms_rad: f64,
    /// Correlation length of the phase, after which the correlation is e^{-1/2}, mm.
    pub correlation_mm: f64,
}

/// A self-affine Gaussian profile.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roughness {
    /// RMS height over all wavelengths, µm.
    pub rms_um: f64,
    /// Hurst exponent, above 0 and at most 1. A larger exponent gives a smoother surface.
    pub hurst: f64,
    /// Wavelength above which the power spectrum is flat, mm.
    pub roll_off_mm: f64,
    /// Wavelength below which the power spectrum is zero, mm.
    pub shortest_mm: f64,
}

/// Effects of measuring. Each is computed only if it is given.
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

/// Physiological tremor: Gaussian, with its power spread evenly over a narrow band, along one fixed direction.
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

/// A sine from the mains with a random phase per trial.
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
    /// Acceleration on x, y, z, m/s².
    pub value_m_s2: [f64; 3],
}

/// White Gaussian noise, independent between axes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// RMS over the whole band on x, y, z, m/s².
    pub rms_m_s2: [f64; 3],
}

/// The sensor's range, beyond which values are cut off.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clipping {
    /// Largest magnitude, in standard gravities. If not given, it is 5, the range of the paper's accelerometer.
    #[serde(default = "Clipping::paper_range_g")]
    pub range_g: f64,
}

impl Clipping {
    fn paper_range_g() -> f64 {
        5.0
    }

    /// The range in m/s².
    pub fn range_m_s2(&self) -> f64 {
        self.range_g * GRAVITY_M_S2
    }
}
