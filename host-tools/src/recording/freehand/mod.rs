//! Recordings of a free hand: accelerations with the speed and force of every moment, cut where the motion is nearly
//! steady, and put on a grid.
//!
//! Blocks of 20 ms are taken together as long as speed and force each stay within a band around their middle
//! ([`Tolerance`]). A piece that is long enough is a trial at its *median* speed and force, and belongs to the grid's node
//! nearest to them, if that is no further than half a step. A node with too little data in all is left out and named.
//!
//! Values that no hand and no sensor has (10⁵ N) are named with their line; their blocks are cut out, and no piece goes
//! across them. A file in which more than one sample in ten is such a value is refused: something else is wrong with it.

mod read;
mod segment;
mod write;

pub use read::{Freehand, Outlier, read};
pub use segment::{GridAxis, Options, Placed, Segment, Segmentation, Tolerance, segment};
pub use write::write;
