//! The account of a texture's excitation that a fit gives.

use serde::{Deserialize, Serialize};

use super::evidence::Evidence;

/// A codebook of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodebookReport {
    /// Lowest and highest speed of its nodes, mm/s.
    pub speeds_mm_s: [f32; 2],
    /// Lowest and highest force of its nodes, N.
    pub forces_n: [f32; 2],
    /// Local kurtosis of the trials there, in data that was not fitted.
    pub kurtosis: Evidence,
    /// Number of trials that its material is of.
    pub trials: usize,
    /// Duration, s.
    pub seconds: f64,
    /// Highest peak, standard deviations.
    pub peak: f32,
    /// Samples whose peak was cut, because the excitation has no room for it.
    pub cut_samples: usize,
    /// Ratio of its power to that of the error of its codes, dB.
    pub snr_db: f64,
}

/// A level track of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackReport {
    /// Number of trials that it is joined from.
    pub trials: usize,
    /// Number of entries.
    pub entries: usize,
    /// Time from one entry to the next, s.
    pub step_s: f64,
    /// Lowest and highest level, dB.
    pub range_db: [f64; 2],
}

/// The choice of a texture's excitation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExcitationReport {
    /// The texture.
    pub texture: String,
    /// Local kurtosis of all trials, in data that was not fitted; 2.9 of Gaussian noise.
    pub kurtosis: Evidence,
    /// Spread of levels of all trials, in data that was not fitted, dB; 0.4 of steady Gaussian noise.
    pub spread_db: Evidence,
    /// The codebooks, none for Gaussian noise.
    pub codebooks: Vec<CodebookReport>,
    /// The level track, none for a steady level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track: Option<TrackReport>,
    /// Reason for the source.
    pub source: String,
    /// Reason for the level.
    pub level: String,
}
