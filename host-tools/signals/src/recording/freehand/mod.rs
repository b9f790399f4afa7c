//! Recordings of a free hand: accelerations with the speed and force at each sample. They are cut into segments of
//! nearly steady motion, which are assigned to the nodes of a grid.
//!
//! Successive blocks of 20 ms form a segment as long as speed and force each stay within a band around the middle of
//! their range ([`Tolerance`]). A segment that is long enough belongs to the nearest node of the grid, if its *median*
//! speed and force are within half a step of this node, and becomes a trial at the node's speed and force. A node with
//! too little data is left out and reported.
//!
//! Values that no hand and no sensor can produce (10⁵ N) are outliers. The first 20 are reported with their line, and
//! no segment includes a block with an outlier. A file in which more than a tenth of the samples have an outlier is
//! refused, because its columns or units are then likely to be wrong.
//!
//! A block ends a segment if within it the direction of motion changes, or the speed jumps by more than a hand can
//! cause (such as when an encoder loses a count). Segments also end where the direction changes between blocks. The
//! jumps, and the changes of direction from one moving block to the next, are counted.

mod grid;
mod positions;
mod read;
mod segment;
mod write;

pub use grid::{GridAxis, LEAST_FORCE_N, LEAST_SPEED_MM_S, proposed_grid};
pub use read::{Freehand, Outlier, is_simulated, read};
pub use segment::{Options, Placed, Segment, Segmentation, Tolerance, moving, segment};
pub use write::write;
