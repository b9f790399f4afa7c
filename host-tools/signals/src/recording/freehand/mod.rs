//! Recordings of a free hand: accelerations with the speed and force at each sample, cut into segments of nearly steady
//! motion, which are assigned to the nodes of a grid.
//!
//! Successive blocks of 20 ms form a segment as long as speed and force each stay within a band around the middle of
//! their range ([`Tolerance`]). A segment that is long enough is a trial at its *median* speed and force. It belongs to
//! the grid's node nearest to them, if that is within half a step. A node with too little data is left out and
//! reported.
//!
//! Values that no hand and no sensor can have (10⁵ N) are outliers. They are reported with their line, and no segment
//! includes a block with one. A file with more than one outlier per ten samples is refused, because its columns or
//! units are then likely to be wrong.
//!
//! A block breaks a segment, and is counted, if the direction of motion changes in it or if the speed jumps in it by
//! more than a hand can, as an encoder does that loses a count. Segments end where the direction changes.

mod grid;
mod read;
mod segment;
mod write;

pub use grid::{GridAxis, LEAST_FORCE_N, LEAST_SPEED_MM_S, proposed_grid};
pub use read::{Freehand, Outlier, is_simulated, read};
pub use segment::{Options, Placed, Segment, Segmentation, Tolerance, moving, segment};
pub use write::write;
