//! The rig simulator. It follows the paper's measuring protocol (drum speeds by normal forces by textures), and
//! computes the recordings from a physical model.
//!
//! **Invariant: nothing here was measured, and every recording and table that is written says SIMULATED.** Only the
//! model of a rig and its files belong here; fitting, and recordings of a real rig, do not.
//!
//! The simulator tests the chain from recordings to the stylus without a rig. It shows the errors of this chain,
//! because every property of the source is known. A [`RigFile`] names the surfaces, the tool and the effects of
//! measuring. *An effect that the rig file does not name is not computed*: it takes no time and no random numbers.
//! Every effect has its own random stream, so that adding an effect does not change the others by a single bit.
//!
//! # The model
//!
//! A stiff hand-held tool with a hemispherical tip of radius R touches a drum of circumference L. The drum's surface
//! passes at the speed v under the static normal force F. Axes: x along the surface's motion, y across it, z along the
//! normal.
//!
//! **Profile.** The height along the track is one fixed profile per texture and seed, the same for every
//! speed and force, and periodic with the drum: h(x) = Re Σ_{n≥1} cₙ e^{2πi n x / L}.
//! - *Weave*: A · Σ_m b_m cos m(2πx/Λ + φ(x)), b₁ = 1, with Λ rounded to the nearest L/integer. The spacing of yarns
//!   varies by a Gaussian phase φ of given RMS and correlation length ℓ, R_φ(s) ∝ exp(-s²/2ℓ²).
//! - *Roughness*: a self-affine Gaussian field of given RMS height. The power spectrum of a profile depends on the
//!   wavelength λ as S(q) ∝ q^{-(1+2H)}, q = 2π/λ, where H is the Hurst exponent. This holds between a roll-off
//!   wavelength, above which the spectrum is flat, and a shortest wavelength, below which it is zero (Persson, Albohr,
//!   Tartaglino, Volokitin, Tosatti, "On the nature of surface roughness", J. Phys.: Condens. Matter 17, 2005, R1).
//!
//! **Contact.** Hertz (Johnson, *Contact Mechanics*, 1985, ch. 4), with E* the effective modulus of tip
//! and surface: radius a = (3FR / 4E*)^{1/3}; normal stiffness k = dF/dδ = 2E*a, so k ∝ F^{1/3}. The tip is displaced
//! by the mean height under the contact, weighted by the Hertz pressure √(1 - r²/a²). For a profile that is the same
//! across the track, this multiplies the term of wavenumber q by 3(sin u - u cos u)/u³, u = qa (the contact filter of
//! wheel and rail noise, Remington, J. Acoust. Soc. Am. 81, 1987, 1805). At 0 N there is no contact and no vibration.
//! If a loss factor η is given, the stiffness is k(1 + iη).
//!
//! **Tool in the hand.** Modal superposition (Ewins, *Modal Testing*, 2000, ch. 2). A dynamic force
//! f at the tip along z causes, on each axis of the accelerometer, the acceleration f(ω) · Σ_r -ω² p_r / (ω_r² - ω² +
//! 2iζ_r ω_r ω), with the participation p_r in (m/s²)/N. If a mode also has a participation q_r of the tip itself (the
//! displacement of the tip has the same form with q_r, without the factor -ω²), the contact spring lies between the
//! surface and the tip: f = k h / (1 + k G), with G = Σ_r q_r / (ω_r² - ω² + ...). The tip then follows the surface at
//! low frequency, and the tool has a contact resonance that rises with force. If no mode has it, the tip is held
//! rigidly: f = k h.
//!
//! **Motion.** x = x₀ + vt, with a random x₀ for each trial. The model above is linear, so the steady state is a
//! Fourier series in x, whose n-th term is multiplied by the response at the frequency nv/L. Terms at or above half the
//! sample rate are left out, as an ideal anti-alias filter would do. A chirp z-transform evaluates the series exactly
//! at the sample instants, so there are no interpolation errors and no aliases at any speed. If the drum's speed
//! wanders, with a Gaussian deviation of given RMS and correlation time, x is the integral of the speed, and the series
//! is evaluated at x by interpolation.
//!
//! **Measuring**, in this order: physiological tremor (Gaussian, in a narrow band), mains hum, offset, white sensor
//! noise, clipping at the sensor's range.
//!
//! # Limits of the model
//!
//! The model leaves out loss of contact and the Hertz spring's curvature (it is linear in h); stick-slip, and any
//! friction beyond a mode's participation on x; wear; a profile that varies across the track, and a strip shorter than
//! the drum; run-out of the drum; the tool's response at any speed but the nominal one; drift of the force; start and
//! stop; quantisation; the sensor's own resonance. Real recordings have all of these, so a figure obtained on simulated
//! trials says nothing about real ones.
//!
//! # Repeatability
//!
//! Every random stream is determined by the seed, the texture's name, the trial's speed and force, and the effect. On
//! the same build, the same rig and seed give the same bytes for any number of threads. Adding a speed, a force or a
//! texture does not change the other trials.
//!
//! # The content of a rig file
//!
//! A [`RigDescription`] has the rig, the strips on its drum, the trials, and the effects of measuring: plain values, as
//! in the TOML text. A [`RigFile`] has a description that was checked.

mod contact;
mod file;
mod measurement;
mod output;
mod profile;
mod series;
#[cfg(test)]
mod tests;
mod trial;

use serde::Deserialize;

use crate::recording::GRAVITY_M_S2;

pub use file::RigFile;
pub use output::{Summary, TextureSummary, simulate, simulate_to_folder};

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
