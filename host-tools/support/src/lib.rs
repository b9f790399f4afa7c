//! Tools that every other wing needs: the error type and warnings by kind, files read up to a limit, tables as CSV, WAV
//! files, dates, files on the disk or in memory, files and folders written whole or not at all, names for files and
//! names like a given one, numbers in texts and bounds of a hand's motion, hashes of content, safe display of text,
//! parallel work in order, progress bars, and fields of a TOML text.
//!
//! Invariant: nothing here works on signals, textures or devices, and nothing here imports another wing.

pub mod atomic_file;
pub mod bounded_file;
pub mod csv_table;
pub mod date;
mod error;
pub mod files;
pub mod float_wav;
pub mod fnv;
pub mod in_order;
pub mod names;
pub mod number;
pub mod output;
pub mod progress;
pub mod temporaries;
pub mod toml_field;
pub mod visible;

pub use error::{Error, Result, Warning, by_kind};
