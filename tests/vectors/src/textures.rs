//! Textures that are played and measured.

use stylus_kernel::UPDATE_INTERVAL_SAMPLES;

use crate::path::PATH_UPDATES;

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
