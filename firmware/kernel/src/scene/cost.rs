//! What a plan costs the tick, in instructions: a base and so much for each of something, stage by stage.
//!
//! **The constants are counts** of the image on the virtual stylus, whose test `scenes` holds them against the ticks of the image as
//! it was built: never below what is counted, and not far above. Instructions are not cycles.

use core::fmt;

use heapless::Vec;
use model_format::{Structure, Texture};

use super::block::{MAX_STAGES, SLOTS};
use crate::arithmetic::TURN_TAPS;

/// Instructions of the sample's path whatever is played: the list of stages, the sum of voices, its saturation. A list that is
/// empty takes 22 of them.
pub const MIX: StageCost = StageCost { base: 53, each: 0 };

/// A voice of a normalised lattice; each is a stage of it.
pub const LATTICE: StageCost = StageCost {
    base: 151,
    each: 11,
};

/// A voice of a direct form; each is a turn of [`TURN_TAPS`] taps of the predictor.
pub const DIRECT: StageCost = StageCost {
    base: 212,
    each: 107,
};

/// What stick-slip adds to a voice.
pub const STICK_SLIP: StageCost = StageCost { base: 46, each: 0 };

/// A tap transient.
pub const TAP: StageCost = StageCost { base: 37, each: 0 };

/// The equaliser; each is a section.
pub const EQUALISER: StageCost = StageCost { base: 53, each: 81 };

/// The fade while scenes are exchanged.
pub const FADE_OUT: StageCost = StageCost { base: 25, each: 0 };

/// Instructions that a scene may take of a tick: at the device's 400 MHz a period of 200 µs is 80 000 cycles, at two cycles an
/// instruction, which is pessimistic, 40 000 instructions; half of it is for safety, inputs, interrupts and margin.
pub const BUDGET: u32 = 20_000;

/// Instructions of a stage at each sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageCost {
    /// Once.
    pub base: u16,
    /// For each stage of a lattice, turn of a predictor's taps, or section.
    pub each: u16,
}

/// What a term is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// [`MIX`].
    Mix,
    /// The voice of a surface, with its texture's structure.
    Voice {
        /// Which surface.
        surface: u8,
        /// The structure of its texture.
        structure: Structure,
    },
    /// The stick-slip of a surface.
    StickSlip {
        /// Which surface.
        surface: u8,
    },
    /// A tap transient.
    Tap,
    /// The equaliser.
    Equaliser,
    /// The fade while scenes are exchanged.
    FadeOut,
}

/// One line of the arithmetic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// What it is for.
    pub item: Item,
    /// What it costs.
    pub cost: StageCost,
    /// How many of what it counts.
    pub count: u16,
}

/// The most that a plan takes of a tick, with the arithmetic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    terms: Vec<Term, { MAX_STAGES + SLOTS + 1 }>,
}

/// A plan that takes more of a tick than there is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OverBudget {
    /// What it takes.
    pub cost: Cost,
    /// What there is, instructions.
    pub budget: u32,
}

impl Term {
    /// Instructions.
    pub const fn instructions(&self) -> u32 {
        self.cost.base as u32 + self.cost.each as u32 * self.count as u32
    }

    pub(super) fn voice(surface: u8, texture: &Texture<'_>) -> Self {
        let (structure, order) = (texture.structure(), texture.max_order());
        let (cost, count) = match structure {
            Structure::NormalisedLattice => (LATTICE, order),
            Structure::DirectForm16 | Structure::DirectForm32 => {
                (DIRECT, order.div_ceil(TURN_TAPS))
            }
        };
        Self {
            item: Item::Voice { surface, structure },
            cost,
            count: count as u16,
        }
    }

    pub(super) const fn once(item: Item, cost: StageCost) -> Self {
        Self {
            item,
            cost,
            count: 0,
        }
    }
}

impl Cost {
    pub(super) fn add(&mut self, term: Term) {
        // There is room for one term of each stage.
        let _ = self.terms.push(term);
    }

    /// The lines of the arithmetic.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Instructions at each sample.
    pub fn instructions(&self) -> u32 {
        self.terms.iter().map(Term::instructions).sum()
    }

    /// The cost again, if it is within `budget` instructions.
    ///
    /// # Errors
    /// It is not.
    pub fn within(self, budget: u32) -> Result<Self, OverBudget> {
        if self.instructions() <= budget {
            Ok(self)
        } else {
            Err(OverBudget { cost: self, budget })
        }
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mix => f.write_str("mix"),
            Self::Voice { surface, structure } => write!(f, "surface {surface}, {structure}"),
            Self::StickSlip { surface } => write!(f, "surface {surface}, stick-slip"),
            Self::Tap => f.write_str("tap"),
            Self::Equaliser => f.write_str("equaliser"),
            Self::FadeOut => f.write_str("fade"),
        }
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let StageCost { base, each } = self.cost;
        if each == 0 {
            write!(f, "{}: {base}", self.item)
        } else {
            let (count, sum) = (self.count, self.instructions());
            write!(f, "{}: {base} + {count} x {each} = {sum}", self.item)
        }
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for term in &self.terms {
            write!(f, "{term}; ")?;
        }
        write!(f, "together {} instructions", self.instructions())
    }
}

impl fmt::Display for OverBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (cost, budget) = (&self.cost, self.budget);
        write!(f, "the scene takes {cost}, and a tick has {budget} for it")
    }
}

impl core::error::Error for OverBudget {}
