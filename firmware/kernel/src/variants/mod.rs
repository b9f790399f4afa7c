//! Structures that the product does not ship, for the comparison of accuracy and time (`stylus frontier`), under the feature
//! `variants`, which no image has.
//!
//! Both play a texture that is stored as a normalised lattice: their coefficients are made from the same interpolated θ,
//! so that what differs is the arithmetic alone.

pub mod normalised16;
mod theta;
pub mod two_multiplier;
