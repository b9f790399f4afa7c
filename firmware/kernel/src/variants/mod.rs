//! Structures that are compared and not shipped: `stylus frontier` measures their accuracy and time. They need the
//! feature `variants`, which no image has.
//!
//! Both play a texture that is stored as a normalised lattice. Their coefficients are made from the same interpolated
//! θ, so that only the arithmetic differs.

pub mod normalised16;
mod theta;
pub mod two_multiplier;
