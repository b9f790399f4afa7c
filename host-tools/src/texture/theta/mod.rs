//! The bytes of a lattice's θ: in the fewest, if the spectrum of every node allows it.
//!
//! All textures have the first 32 stages in 16 bits or more. *Fine* ones have 24 bits there and 16 bits in the stages
//! after them. *Compact* ones have 24 bits in the first stages alone and one byte per stage after the 32nd, with a
//! range per node: half of the bytes at order 400.

mod choice;
mod judge;
mod report;
mod size;
#[cfg(test)]
mod tests;

pub use choice::{LARGEST_ERROR, StoredTheta, ThetaChoice};
pub use judge::{all_allow_compact, store};
pub use report::{NodeError, ThetaReport, summary};
pub use size::bytes_per_node;
