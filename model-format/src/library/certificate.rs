//! The certificate of a texture's stability, as a reader sees it.

/// Certificate of a texture's stability at every point of its grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Certificate<'a> {
    /// No certificate; only [`crate::Library::decode_uncertified`] lets such a texture through.
    None,
    /// Certificate of a normalised lattice, which is stable wherever all |θ| are below π/2: at every weighted mean of
    /// its nodes, and under every change of coefficients. The decoder has found this largest θ itself.
    Lattice {
        /// Largest |θ| of all nodes, in steps of [`crate::FINE_THETA_STEP_RAD`]; below 2²³.
        largest_theta: u32,
    },
    /// Certificate of a direct form, for which a host has proved every cell stable. The decoder has checked that it was
    /// issued for these very axes, nodes and coefficients, and for every cell; it has not repeated the proof.
    DirectForm {
        /// One byte per cell, speed-major, as many as [`crate::Texture::cell_counts`] spans. The |A| of every weighted
        /// mean of the cell's nodes is at least 2^(-byte / [`CELL_MARGIN_STEPS_PER_OCTAVE`]) on the whole unit circle.
        cell_margins: &'a [u8],
    },
}

/// Steps per octave in which [`Certificate::DirectForm`] stores a cell's margin.
pub const CELL_MARGIN_STEPS_PER_OCTAVE: u8 = 4;

/// Byte of a cell that is not certified.
pub const UNCERTIFIED_CELL: u8 = u8::MAX;
