//! Tools that every other wing needs: the error type, files read up to a limit, tables as CSV, WAV files, dates, files
//! on the disk or in memory, files and folders written whole or not at all, decimals, names of files, names like a
//! given one, numbers of options, bounds of a hand's motion, hashes of content, safe display of text, warnings by kind,
//! parallel work in order, progress bars, fields of a TOML text, and a setting of how the allocator handles freed
//! memory.
//!
//! Invariant: nothing here works on signals, textures or devices, and nothing here imports another wing.

pub mod atomic_file;
pub mod bounded_file;
pub mod csv_table;
pub mod date;
pub mod decimal;
mod error;
pub mod file_name;
pub mod files;
pub mod float_wav;
pub mod fnv;
pub mod freed_memory;
pub mod hand;
pub mod in_order;
pub mod nearest;
pub mod number;
pub mod output;
pub mod progress;
pub mod temporaries;
pub mod toml_field;
pub mod visible;
pub mod warning;

pub use error::{Error, Result};
