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

mod contact;
mod description;
mod file;
mod measurement;
mod output;
mod profile;
mod series;
#[cfg(test)]
mod tests;
mod trial;

pub use description::{
    Clipping, Drum, Hum, Jitter, Measurement, Mode, Noise, Offset, Recording, RigDescription, Roughness, Texture, Tool,
    Tremor, Wander, Weave,
};
pub use file::RigFile;
pub use output::{Summary, TextureSummary, simulate, simulate_to_folder};
