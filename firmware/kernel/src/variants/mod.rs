//! Structures that are compared and not shipped: `stylus frontier` measures their accuracy and time. They need the
//! feature `variants`, which no image has.
//!
//! All play a texture that is stored as a normalised lattice. The coefficients of the lattices are made from the same
//! interpolated θ, so that only the arithmetic differs; the direct form interpolates its own.

pub mod direct;
pub mod normalised16;
mod theta;
pub mod two_multiplier;
