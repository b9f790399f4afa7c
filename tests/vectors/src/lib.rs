//! Textures and a motion from which every processor must compute the same bits.
//!
//! Host and target play the same library, [`library`] (feature `library`, for hosts), along the same path of the hand,
//! [`motion`], and their output is compared sample by sample. The textures are made from a seed such that they reach
//! every path of the kernel: one node and grids, orders that differ from node to node, steep resonances, silent nodes,
//! full scale, fractions of θ, every law of the level, codebooks, and two voices at a time.
#![no_std]

#[cfg(feature = "library")]
extern crate alloc;

mod edges;
mod hard;
pub mod job;
#[cfg(feature = "library")]
mod library;
mod path;
mod play;
pub mod report;
pub mod scenes;
mod textures;

pub use edges::edges;
pub use hard::{HardCase, Way};
pub use job::Libraries;
#[cfg(feature = "library")]
pub use library::{COUNTED_ORDERS, DIGESTED, counted_library, counted_texture, digest_library, library, specs};
pub use path::{COUNTED_UPDATES, PATH_UPDATES, counted_motion, motion};
pub use play::{PlayError, run};
pub use textures::{COST_BUDGETS, CostBudget, VECTORS, Vector};
