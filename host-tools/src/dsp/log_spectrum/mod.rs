//! Logarithms of power spectra: estimated from recordings with little leakage, taken from models, warped from one speed
//! to another, and turned back into models.
//!
//! Values are evenly spaced from 0 Hz to half the models' sample rate. Each is the natural logarithm of the two-sided
//! density times the sample rate, so that the mean of their exponentials over all frequencies is the power. Spectra of
//! recordings have [`BINS`] values, [`STEP_HZ`] apart. Spectra of models may have more, because a resonance of a model
//! can be narrower than any that a recording resolves.

mod distance;
mod estimate;
mod models;
mod rate;
mod values;

pub use models::density_of_model;
pub use values::{BINS, FINE_BINS, LogSpectrum, STEP_HZ};
