//! Textures between a fit and a library: grids of models and their quantisation.
//!
//! Invariant: models in, library entries out. Nothing in this module reads a recording's file or estimates a model from
//! one.

pub mod grid;
pub mod library;
pub mod quantise;
pub mod summary;
pub mod theta;
