//! Tools that every other wing needs: the error type, files read up to a limit, files written whole or not at all,
//! names of files, text made fit to be shown, progress bars, and fields of a TOML text.
//!
//! Invariant: nothing here knows of signals, textures or devices, and nothing here imports another wing.

pub mod atomic_file;
pub mod bounded_file;
pub mod error;
pub mod file_name;
pub mod progress;
pub mod toml_field;
pub mod visible;
