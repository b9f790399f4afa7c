//! Accuracy against time: every structure, order and update interval, with its error and its cycles, and the Pareto
//! front of both.
//!
//! **At rest** ([`still`]): the nodes of textures, played by the kernel and its variants, against recordings that the
//! fit has not seen. **In motion** ([`moving`]): a hand that rubs over the grid, against float64 at every sample.
//! **Hard cases** ([`hard`]): those of `stylus stress`, with models cut to the order. **Time** ([`costs`]):
//! instructions counted on QEMU, and cycles of the Cortex-M4's published timings, from `cargo tasks costs`. **Parts**
//! ([`PartsRow`]): excitation, modulation and lines of the lattice, which no spectrum shows.
//!
//! The error of a choice is the root of the sum of squares of its error at rest and its error in motion, in
//! third-octave bands: the one is of the models, the other of following the hand, and they do not know of each other.
//! Its time is a sample's and its share of an update's.

pub mod costs;
mod earlier;
mod fronts;
pub mod hard;
mod material;
pub mod moving;
mod number;
mod options;
mod pareto;
mod parts;
mod players;
mod predictors;
mod prepared;
mod results;
mod run;
pub mod still;
mod structure;

pub use earlier::{Change, Earlier, Place};
pub use material::Material;
pub use options::{CLOCKS_HZ, INTERVALS, ORDERS, Options};
pub use parts::{PARTS_COLUMNS, PartsRow};
pub use prepared::Prepared;
pub use results::{Filter, Frontier, Point, interval_ms, share};
pub use structure::{FilterStructure, Voice};
