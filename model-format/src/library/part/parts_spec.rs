//! The optional parts of a texture to be written.

use super::excitation::ExcitationSpec;
use super::lines::LinesSpec;
use super::modulation::ModulationSpec;

/// Optional parts of a texture to be written, beside those that follow from its laws and nodes.
///
/// By default there are none: a Gaussian excitation of steady level, and nothing that is locked to place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartsSpec {
    /// Codebooks of the residual.
    pub excitation: Option<ExcitationSpec>,
    /// Track of the level.
    pub modulation: Option<ModulationSpec>,
    /// Lines that are locked to place.
    pub lines: Option<LinesSpec>,
}
