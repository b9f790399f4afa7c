//! The outcome of a fit.

use model_format::{Provenance, TextureSpec};

use crate::texture::grid::Grid;

use super::excitation::ExcitationReport;
use super::trial_report::TrialReport;

/// A fitted texture.
#[derive(Clone, Debug)]
pub struct FittedTexture {
    /// Name.
    pub name: String,
    /// Origin of its recordings.
    pub provenance: Provenance,
    /// Its models.
    pub grid: Grid,
}

/// The outcome of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// The textures, ready to be encoded.
    pub specs: Vec<TextureSpec>,
    /// The textures before quantisation, in the same order.
    pub textures: Vec<FittedTexture>,
    /// Their excitations, in the same order; none if the fit was of the models alone.
    pub excitations: Vec<ExcitationReport>,
    /// Notes for the user, one line each.
    pub warnings: Vec<String>,
}
