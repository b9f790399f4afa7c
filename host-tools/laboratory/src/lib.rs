//! The laboratory: what a page asks of the host's tools, in one place, over [files in memory](stylus_support::files).
//!
//! A page puts recordings by name, and asks. Every answer comes from the functions that the command calls, so that a
//! list, a library, a record, a page and an error are the command's own. State is in the files alone: an instance that
//! gets the same files gives the same answers.

mod ask;
mod rows;
mod zip;

#[cfg(target_arch = "wasm32")]
mod exports;

pub use ask::{Answer, Asked, answer};
pub use rows::Row;
