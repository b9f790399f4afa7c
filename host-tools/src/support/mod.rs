//! Tools that every other wing needs: the error type, files written whole or not at all, progress bars, and fields of a
//! TOML text.
//!
//! Invariant: nothing here knows of signals, textures or devices, and nothing here imports another wing.

pub mod atomic_file;
pub mod error;
pub mod progress;
pub mod toml_field;
