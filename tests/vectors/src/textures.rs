//! Textures that are played and measured, and the path of the hand along which they are.

use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::{Motion, UPDATE_INTERVAL_SAMPLES};

/// A texture that is played to compare bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vector {
    /// Name of the texture in the library. If two textures are played at once, a name of the pair.
    pub texture: &'static str,
    /// Names of two textures in a scene whose transition plays both; `None` for one texture.
    pub beside: Option<[&'static str; 2]>,
    /// Seed of the excitation.
    pub seed: u64,
    /// Number of samples, enough for more than one round of the path.
    pub samples: u32,
}

impl Vector {
    const fn new(texture: &'static str, seed: u64) -> Self {
        let samples = (PATH_UPDATES + PATH_UPDATES / 4) * UPDATE_INTERVAL_SAMPLES;
        Self {
            texture,
            beside: None,
            seed,
            samples,
        }
    }

    const fn beside(name: &'static str, textures: [&'static str; 2], seed: u64) -> Self {
        Self {
            beside: Some(textures),
            ..Self::new(name, seed)
        }
    }
}

/// All textures of the library, and pairs of them played at once.
pub const VECTORS: [Vector; 14] = [
    Vector::new("lattice, one node", 10),
    Vector::new("lattice", 1),
    Vector::new("lattice of unequal orders", 2),
    Vector::new("lattice of largest angles", 3),
    Vector::new("fine lattice, mean dB", 11),
    Vector::new("fine lattice of largest angles, mean amplitude", 12),
    Vector::beside(
        "two voices with snippets",
        ["lattice, snippets", "lattice, snippets and four lines"],
        20,
    ),
    Vector::beside("two voices, one plain", ["lattice, snippets", "lattice"], 21),
    Vector::new("lattice, four lines", 22),
    Vector::new("lattice with rest, one line", 23),
    Vector::new("lattice, snippets and four lines", 24),
    Vector::new("compact lattice, mean dB", 25),
    Vector::new("lattice, four lines that wander", 26),
    Vector::new("lattice, snippets", 26),
];

/// The largest costs that a texture may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CostBudget {
    /// Name of the texture in the library. The texture's highest order is the limit, 400.
    pub texture: &'static str,
    /// Largest number of instructions that one sample may take.
    pub budget_instructions: u32,
    /// Largest number of instructions that one update may take.
    pub update_budget_instructions: u32,
}

/// One texture for each path through the kernel, with the largest costs of a sample and of an update on a Cortex-M4 or
/// M7.
pub const COST_BUDGETS: [CostBudget; 6] = [
    CostBudget {
        texture: "lattice",
        budget_instructions: 4800,
        update_budget_instructions: 10_000,
    },
    CostBudget {
        texture: "fine lattice, mean dB",
        budget_instructions: 5100,
        update_budget_instructions: 11_000,
    },
    CostBudget {
        texture: "compact lattice, mean dB",
        budget_instructions: 5100,
        update_budget_instructions: 12_000,
    },
    CostBudget {
        texture: "lattice, four lines",
        budget_instructions: 5300,
        update_budget_instructions: 12_500,
    },
    CostBudget {
        texture: "lattice, four lines that wander",
        budget_instructions: 5300,
        update_budget_instructions: 16_000,
    },
    CostBudget {
        texture: "lattice, snippets",
        budget_instructions: 5100,
        update_budget_instructions: 13_500,
    },
];

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
