//! The library of test textures that `build.rs` makes.

/// The library's bytes.
pub static LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/library.bin"));
