//! Levels of the sensors: what the tool feels now, and the noise of the force at rest.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Levels of the sensors over the last whole window. Levels are in decibel as of ISO 1683, 0 for all below 1 of the
/// reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
pub struct Levels {
    /// Number of samples of the window; 0 before the first one is complete.
    pub samples: u32,
    /// RMS of the acceleration of all axes together, without its mean, dB re 1 µm/s².
    pub vibration_decibel: f32,
    /// Mean force, N.
    pub force_newton: f32,
    /// Standard deviation of the force, dB re 1 µN.
    pub force_noise_decibel: f32,
}
