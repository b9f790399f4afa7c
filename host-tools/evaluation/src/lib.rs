//! Judgements of textures: against recordings, against removed nodes, against hard cases, and against their costs.
//!
//! Invariant: results are data. Nothing here draws or prints, and only the recordings that the frontier simulates are
//! written to files.

pub mod evaluate;
pub mod frontier;
pub mod held_out;
mod impulses;
pub mod leave_one_out;
pub mod listening;
pub mod liveliness;
mod loudness;
mod perception;
pub mod played;
pub mod stress;
pub mod strokes;
pub mod summary;
pub mod table;
pub mod verdict;
