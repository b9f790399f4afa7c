//! Cost of a plan in instructions per sample: for each stage a base, and a cost per lattice stage, line or section.
//!
//! **The constants are counts** of the image on the virtual stylus. Its test `cost` compares them with the ticks of the
//! built image: they are never below the counts, and not far above. Instructions are not cycles.

use core::fmt;

use heapless::Vec;
use model_format::{PlayRate, Texture};

use super::playback::{MAX_STAGES, SLOTS};

/// Instructions of every sample: the list of stages, the sum of voices, its saturation. For an empty list 22 suffice.
pub const MIX: StageCost = StageCost { base: 70, each: 0 };

/// A voice of a normalised lattice, with `each` per stage of the lattice.
pub const LATTICE: StageCost = StageCost { base: 153, each: 11 };

/// A voice of a fed lattice, like [`LATTICE`]. Its excitation is read from the frame, and it has one more call and one
/// more saturation.
pub const FED_LATTICE: StageCost = StageCost { base: 182, each: 11 };

/// Instructions of the update per sample of a fed voice: a sample of the noise or of a codebook, and the choice of a
/// snippet. A test counts updates in QEMU against it.
pub const FEED: u32 = 450;

/// Stick-slip of a voice, in addition to the voice.
pub const STICK_SLIP: StageCost = StageCost { base: 51, each: 0 };

/// Lines of a voice, in addition to the voice, with `each` per line.
pub const LINES: StageCost = StageCost { base: 45, each: 37 };

/// A tap transient.
pub const TAP: StageCost = StageCost { base: 43, each: 0 };

/// A probe's waveform.
pub const WAVE: StageCost = StageCost { base: 28, each: 0 };

/// The equaliser, with `each` per section.
pub const EQUALISER: StageCost = StageCost { base: 56, each: 83 };

/// The fade while scenes change.
pub const FADE_OUT: StageCost = StageCost { base: 27, each: 0 };

/// Instructions per tick that a scene may take. At the device's 400 MHz a period of 200 µs is 80 000 cycles, or 40 000
/// instructions at two cycles per instruction, which is pessimistic. Half of them are for safety, inputs, interrupts
/// and margin. The codes of a tick are due 137.5 µs after its trigger, or after 27 500 such instructions.
pub const BUDGET: u32 = 20_000;

/// Instructions that each sample may take, if a tick may take `budget`: all of them at 5 kHz, half at 10 kHz, where a
/// tick computes two samples.
pub const fn budget_per_sample(budget: u32, sample_rate_hz: u32) -> u32 {
    match PlayRate::of(sample_rate_hz) {
        Some(rate) => budget / rate.samples_per_tick(),
        None => budget,
    }
}

/// Instructions of a stage per sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageCost {
    /// Instructions independent of the count.
    pub base: u16,
    /// Instructions per stage of a lattice, line, or section.
    pub each: u16,
}

/// What a term is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// [`MIX`].
    Mix,
    /// The voice of a surface.
    Voice {
        /// Index of the surface.
        surface: u8,
    },
    /// The stick-slip of a surface.
    StickSlip {
        /// Index of the surface.
        surface: u8,
    },
    /// The lines of a surface's texture.
    Lines {
        /// Index of the surface.
        surface: u8,
    },
    /// A tap transient.
    Tap,
    /// A probe's waveform.
    Wave,
    /// The equaliser.
    Equaliser,
    /// The fade while scenes change.
    FadeOut,
}

/// One term of a plan's cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// What the term is about.
    pub item: Item,
    /// Cost of one stage.
    pub cost: StageCost,
    /// Number of lattice stages, lines or sections.
    pub count: u16,
}

/// The worst case of a plan, as a sum of terms.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    terms: Vec<Term, { MAX_STAGES + SLOTS + 1 }>,
}

/// A plan whose worst case is above the budget.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OverBudget {
    /// Cost of the plan.
    pub cost: Cost,
    /// The budget, instructions per sample.
    pub budget: u32,
}

impl Term {
    /// Instructions of the term per sample.
    pub const fn instructions(&self) -> u32 {
        self.cost.base as u32 + self.cost.each as u32 * self.count as u32
    }

    pub(super) fn voice(surface: u8, texture: &Texture<'_>) -> Self {
        Self {
            item: Item::Voice { surface },
            cost: if texture.is_fed() { FED_LATTICE } else { LATTICE },
            count: texture.max_order() as u16,
        }
    }

    /// The lines of a texture, if it has any.
    pub(super) fn lines(surface: u8, texture: &Texture<'_>) -> Option<Self> {
        let lines = texture.lines()?;
        Some(Self {
            item: Item::Lines { surface },
            cost: LINES,
            count: lines.len() as u16,
        })
    }

    pub(super) const fn once(item: Item, cost: StageCost) -> Self {
        Self { item, cost, count: 0 }
    }
}

impl Cost {
    pub(super) fn add(&mut self, term: Term) {
        // There is space for the mix, for one term of each stage, and for one more of each voice.
        let _ = self.terms.push(term);
    }

    /// Terms of the sum.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Sum of all terms, instructions per sample.
    pub fn instructions(&self) -> u32 {
        self.terms.iter().map(Term::instructions).sum()
    }

    /// Returns the cost if it is within `budget` instructions per sample.
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
            Self::Voice { surface } => write!(f, "surface {surface}, normalised lattice"),
            Self::StickSlip { surface } => write!(f, "surface {surface}, stick-slip"),
            Self::Lines { surface } => write!(f, "surface {surface}, lines"),
            Self::Wave => f.write_str("probe"),
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
        write!(f, "the scene takes {cost}, and the budget of a sample is {budget}")
    }
}

impl core::error::Error for OverBudget {}
