//! The outcome of a fit.

use std::sync::Arc;

use model_format::{Provenance, TextureSpec};

use crate::support::error::{Error, Result};
use crate::support::warning::Warning;
use crate::texture::grid::Grid;

use super::excitation::ExcitationReport;
use super::lines::Findings;
use super::trial::TrialReport;

/// A fitted texture.
#[derive(Clone, Debug)]
pub struct FittedTexture {
    /// Name.
    pub name: String,
    /// Origin of its recordings.
    pub provenance: Provenance,
    /// Its models.
    pub grid: Grid,
    /// Lines that are locked to place, or the reason for none.
    pub lines: Arc<Findings>,
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
    /// Notes for the user.
    pub warnings: Vec<Warning>,
}

impl Fit {
    /// Encodes its textures as a library.
    ///
    /// # Errors
    /// Textures that no library holds.
    pub fn library(&self) -> Result<Vec<u8>> {
        encoded(&self.specs)
    }
}

/// Encodes a library of `specs`.
///
/// # Errors
/// Textures that no library holds.
pub fn encoded(specs: &[TextureSpec]) -> Result<Vec<u8>> {
    model_format::encode(specs)
        .map_err(|failure| Error::Model(format!("the textures do not make a library: {failure}")))
}
