//! Part of kind 3: codebooks of the prediction residual, from which the excitation is pieced together.

use alloc::vec::Vec;

/// Codebooks of a texture, and the one that each node has.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSpec {
    /// The codebooks.
    pub codebooks: Vec<CodebookSpec>,
    /// The source of each node's excitation, speed-major: 0 for Gaussian noise, k for codebook number k, from 1.
    pub of_nodes: Vec<u8>,
}

/// A codebook: successive samples of a prediction residual whose level was made even, with a mean square of 1.
#[derive(Clone, Debug, PartialEq)]
pub struct CodebookSpec {
    /// Magnitude of the codes ±127, standard deviations.
    pub peak: f32,
    /// Samples at the texture's rate, by the mu-law with mu = 255:
    /// sign(c) · peak · (256^(|c| / 127) - 1) / 255. No code is -128.
    pub codes: Vec<i8>,
}
