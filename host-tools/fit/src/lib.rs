//! From recordings to the content of a library: fits, textures before they are encoded, and scenes.
//!
//! Invariant: the same recordings and options give the same bytes, with any number of threads, on all processors with
//! the same vector instructions. Others round the transforms differently.

pub mod fit;
pub mod scene;
pub mod texture;
