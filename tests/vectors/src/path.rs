//! The path of the hand along which vectors are played.

use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::Motion;

/// A point in the plane of speed, mm/s, and force, N.
type MotionPoint = (f32, f32);

/// Legs of straight motion in the plane. Where two legs do not meet, the motion jumps.
///
/// The grids of this crate span 40 to 240 mm/s and 0.5 to 2 N, with a node at 120 mm/s.
const LEGS: [(MotionPoint, MotionPoint); 16] = [
    // From rest, below the grid, exactly to a node.
    ((0.0, 0.0), (40.0, 0.5)),
    ((40.0, 0.5), (104.0, 1.0)),
    // Across the common edge of two cells, along it, and to the last node.
    ((104.0, 1.0), (136.0, 1.5)),
    ((120.0, 1.5), (120.0, 0.75)),
    ((120.0, 0.75), (240.0, 2.0)),
    // Above the grid in both speed and force, then only in speed or force.
    ((240.0, 2.0), (600.0, 8.0)),
    ((600.0, 1.0), (80.0, 8.0)),
    // Below the grid only in force, then only in speed.
    ((180.0, 0.125), (60.0, 0.375)),
    ((8.0, 1.0), (24.0, 1.75)),
    // To the opposite direction, through speed zero.
    ((-160.0, 1.0), (160.0, 1.0)),
    // Jumps: lift off, touch down, stand still in contact, and from one corner to another.
    ((200.0, 1.25), (200.0, 1.25)),
    ((200.0, 0.0), (200.0, -1.0)),
    ((90.0, 1.25), (70.0, 0.75)),
    ((0.0, 1.5), (0.0, 1.5)),
    ((239.0, 1.875), (41.0, 0.625)),
    ((180.0, 1.25), (80.0, 1.25)),
];

const UPDATES_PER_LEG: u32 = 8;

/// Number of updates after which the path repeats.
pub const PATH_UPDATES: u32 = LEGS.len() as u32 * UPDATES_PER_LEG;

/// Returns the motion at update `update`, computed by single IEEE 754 operations on few digits. Their results are the
/// same on every processor.
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

/// Returns the motion at update `update` for the table of costs. There is one point of each leg, so that the cell stays
/// on some updates and changes on others.
pub fn counted_motion(update: u32) -> Motion {
    motion(update * UPDATES_PER_LEG + update % UPDATES_PER_LEG)
}
