//! The host and a device: the link between them, and procedures of several requests over it.
//!
//! Invariant: nothing here fits a texture.

pub mod link;
pub mod procedures;
