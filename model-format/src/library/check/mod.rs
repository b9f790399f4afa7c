//! The checks that a texture of a library must pass.

mod certificate;
mod node;
mod texture;

pub(super) use certificate::Demand;
pub(super) use texture::check_texture;
