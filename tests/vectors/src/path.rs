//! Path of the hand.

use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::Motion;

/// A point in the plane of speed, mm/s, and force, N.
type MotionPoint = (f32, f32);

/// Legs of straight motion in the plane. The motion jumps between two legs that do not meet.
///
/// The grids of this crate span 40 to 240 mm/s and 0.5 to 2 N, with a node at 120 mm/s.
const LEGS: [(MotionPoint, MotionPoint); 16] = [
    // From rest, below the grid, to a node exactly.
    ((0.0, 0.0), (40.0, 0.5)),
    ((40.0, 0.5), (104.0, 1.0)),
    // Across the common side of two cells, along it, and to the last node.
    ((104.0, 1.0), (136.0, 1.5)),
    ((120.0, 1.5), (120.0, 0.75)),
    ((120.0, 0.75), (240.0, 2.0)),
    // Above the grid in both, then in one.
    ((240.0, 2.0), (600.0, 8.0)),
    ((600.0, 1.0), (80.0, 8.0)),
    // Below the grid in one.
    ((180.0, 0.125), (60.0, 0.375)),
    ((8.0, 1.0), (24.0, 1.75)),
    // To the opposite direction, through zero.
    ((-160.0, 1.0), (160.0, 1.0)),
    // Jumps: lift off, touch down, stand still in contact, and from corner to corner.
    ((200.0, 1.25), (200.0, 1.25)),
    ((200.0, 0.0), (200.0, -1.0)),
    ((90.0, 1.25), (70.0, 0.75)),
    ((0.0, 1.5), (0.0, 1.5)),
    ((239.0, 1.875), (41.0, 0.625)),
    ((180.0, 1.25), (80.0, 1.25)),
];

const UPDATES_PER_LEG: u32 = 8;

/// Number of updates after which the path begins anew.
pub const PATH_UPDATES: u32 = LEGS.len() as u32 * UPDATES_PER_LEG;

/// The motion at update `update`, by single IEEE 754 operations on few digits, which are the same on every processor.
pub fn motion(update: u32) -> Motion {
    let (from, to) = LEGS[(update / UPDATES_PER_LEG) as usize % LEGS.len()];
    let done = (update % UPDATES_PER_LEG) as f32 / UPDATES_PER_LEG as f32;
    let between = |from: f32, to: f32| from + (to - from) * done;
    let speed = MillimetresPerSecond(between(from.0, to.0));
    let force = Newton(between(from.1, to.1));
    Motion::new(speed, force).expect("the legs' ends are finite")
}

/// Number of updates of [`counted_motion`].
pub const COUNTED_UPDATES: u32 = LEGS.len() as u32;

/// The motion at update `update` for the table of costs: one point of each leg, so that
/// the cell stays on some updates and changes on others.
pub fn counted_motion(update: u32) -> Motion {
    motion(update * UPDATES_PER_LEG + update % UPDATES_PER_LEG)
}
