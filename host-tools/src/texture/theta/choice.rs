//! The forms of θ, and the bounds between them.

use serde::{Deserialize, Serialize};

use crate::dsp::model_error::ModelError;

/// Largest errors of a node that compact θ may make.
///
/// The RMS and the third octave are far below any just noticeable difference, that of amplitude being 2.2 dB
/// ([`crate::dsp::spectrum::AMPLITUDE_JND_DB`]), and below the scatter of two takes of one surface.
pub const LARGEST_ERROR: ModelError = ModelError {
    rms_db: 0.1,
    third_octave_db: 0.2,
    line_db: 0.2,
};

/// The choice of a user.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ThetaChoice {
    /// Compact for each texture whose nodes all keep their spectrum.
    #[default]
    Auto,
    /// 24 bits in the first 32 stages, 16 bits in others.
    Fine,
    /// One byte in stages after the 32nd, whatever the error.
    Compact,
}

/// The form in which a texture's θ is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StoredTheta {
    /// 16 bits or more in all stages.
    Fine,
    /// One byte in stages after the 32nd.
    Compact,
}
