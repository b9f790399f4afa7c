//! The path that the hand takes.

use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::Motion;

/// A place in the plane of speed, mm/s, and force, N.
type Place = (f32, f32);

/// Legs of straight motion in the plane. Where one does not begin where the one before ended, the motion jumps.
///
/// The grids of this crate span 40 to 240 mm/s and 0.5 to 2 N, with a node at 120 mm/s.
const LEGS: [(Place, Place); 16] = [
    // From rest, below the grid, on to a node exactly.
    ((0.0, 0.0), (40.0, 0.5)),
    ((40.0, 0.5), (104.0, 1.0)),
    // Across the cells' common side, along it, and to the last node.
    ((104.0, 1.0), (136.0, 1.5)),
    ((120.0, 1.5), (120.0, 0.75)),
    ((120.0, 0.75), (240.0, 2.0)),
    // Above the grid in both, then in one.
    ((240.0, 2.0), (600.0, 8.0)),
    ((600.0, 1.0), (80.0, 8.0)),
    // Below it in one.
    ((180.0, 0.125), (60.0, 0.375)),
    ((8.0, 1.0), (24.0, 1.75)),
    // The other way along the surface, through zero.
    ((-160.0, 1.0), (160.0, 1.0)),
    // Jumps: lift off, touch down, stand still in contact, and from corner to corner.
    ((200.0, 1.25), (200.0, 1.25)),
    ((200.0, 0.0), (200.0, -1.0)),
    ((90.0, 1.25), (70.0, 0.75)),
    ((0.0, 1.5), (0.0, 1.5)),
    ((239.0, 1.875), (41.0, 0.625)),
    ((180.0, 1.25), (80.0, 1.25)),
];

const UPDATES_A_LEG: u32 = 8;

/// How many updates the path takes before it begins anew.
pub const PATH_UPDATES: u32 = LEGS.len() as u32 * UPDATES_A_LEG;

/// The motion at update `update`. Single operations of IEEE 754 on few digits: the same everywhere.
pub fn motion(update: u32) -> Motion {
    let (from, to) = LEGS[(update / UPDATES_A_LEG) as usize % LEGS.len()];
    let done = (update % UPDATES_A_LEG) as f32 / UPDATES_A_LEG as f32;
    let between = |from: f32, to: f32| from + (to - from) * done;
    let speed = MillimetresPerSecond(between(from.0, to.0));
    let force = Newton(between(from.1, to.1));
    Motion::new(speed, force).expect("the legs' ends are finite")
}

/// How many updates [`counted_motion`] has.
pub const COUNTED_UPDATES: u32 = LEGS.len() as u32;

/// How many samples follow each of them.
pub const COUNTED_SAMPLES: u32 = 4;

/// The motion at update `update` where every instruction is traced, which takes long: one place of each leg, so that the
/// cell stays here and changes there.
pub fn counted_motion(update: u32) -> Motion {
    motion(update * UPDATES_A_LEG + update % UPDATES_A_LEG)
}

/// How many samples each of others' filters makes where every instruction is traced.
pub const PEER_SAMPLES: u32 = 20;
