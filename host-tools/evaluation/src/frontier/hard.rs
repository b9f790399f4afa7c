//! The hard cases at an order: whether a structure keeps what the stylus promises of its lattice, and if not, how badly
//! it fails.

use serde::Serialize;
use stylus_support::Result;

use stylus_costs::Structure;
use stylus_hard_cases::Case;

use super::players::filter_of;
use crate::stress::{self, Outcome};

/// Outcome of a case, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Everything that is promised held.
    Held,
    /// A limit cycle of at most 1 % of full scale remains after the drive, an overdrive or a glitch.
    Residue,
    /// Level, mean, noise or spectrum is outside its promised bound, or the state's norm grows.
    Inaccurate,
    /// The signal was at full scale while the structure was driven as it is meant to be.
    Saturates,
    /// The structure cannot hold the models.
    Refused,
    /// The signal continues loudly forever after the drive stops.
    Latches,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Held => "held",
            Self::Residue => "never quite silent",
            Self::Inaccurate => "inaccurate",
            Self::Saturates => "saturates",
            Self::Refused => "refused",
            Self::Latches => "latches",
        })
    }
}

/// The outcome of all cases.
#[derive(Clone, Debug, Serialize)]
pub struct HardCases {
    /// Number of cases that held.
    pub held: usize,
    /// Number of cases.
    pub cases: usize,
    /// The worst outcome of a case.
    pub worst: Verdict,
    /// Name of the case with the worst outcome; empty if all cases held.
    pub worst_case: String,
}

impl std::fmt::Display for HardCases {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.held, self.cases)
    }
}

/// Fraction of full scale above which a remaining signal is loud.
const LOUD: f64 = 0.01;

/// Returns `case` with its models cut to at most `order`.
pub fn of_order(case: &Case, order: usize) -> Case {
    let mut case = case.clone();
    for (model, _) in &mut case.models {
        // The first stages of a lattice are the model of lower order.
        model.reflection.truncate(order);
    }
    case
}

/// Plays `case` with `structure`.
///
/// # Errors
/// A case whose models cannot be encoded as a library; every case here can.
pub fn play(case: &Case, structure: Structure) -> Result<Verdict> {
    let mut case = case.clone();
    // The reference is a lattice, whose signals have other scales than those of a direct form.
    case.with_reference &= !structure.is_direct();
    let played = stress::play_with(&case, |texture| filter_of(structure, texture).ok())?;
    let Some(mut outcome) = played else {
        return Ok(Verdict::Refused);
    };
    if structure.is_direct() {
        // A small growth of a direct form's state does not count. A lattice's norm cannot grow, because its stages are
        // rotations, but that of the outputs may grow for a while even in a stable direct form.
        for rest in [&mut outcome.stopped, &mut outcome.overdriven, &mut outcome.glitched] {
            if rest.growth_db < 0.1 {
                rest.growing = 0;
            }
        }
    }
    Ok(verdict(&outcome))
}

fn verdict(outcome: &Outcome) -> Verdict {
    let rests = [outcome.stopped, outcome.overdriven, outcome.glitched];
    let endless = || rests.iter().filter(|rest| rest.silent_after.is_none());
    // A case may latch and saturate. To latch is worse, so it is looked for first.
    if endless().any(|rest| rest.left > LOUD) {
        Verdict::Latches
    } else if outcome.saturated > 0 {
        Verdict::Saturates
    } else if outcome.broken().is_empty() {
        Verdict::Held
    // Every promise that is broken is that of silence.
    } else if endless().next().is_some() && outcome.broken().len() == endless().count() {
        Verdict::Residue
    } else {
        Verdict::Inaccurate
    }
}

/// Summarises the verdicts of one or more cases, each with the case's name.
pub fn summarise(verdicts: &[(&str, Verdict)]) -> HardCases {
    let held = verdicts.iter().filter(|(_, verdict)| *verdict == Verdict::Held);
    let mut worst = verdicts[0];
    for &other in verdicts {
        if other.1 > worst.1 {
            worst = other;
        }
    }
    HardCases {
        held: held.count(),
        cases: verdicts.len(),
        worst: worst.1,
        worst_case: if worst.1 == Verdict::Held {
            String::new()
        } else {
            worst.0.to_owned()
        },
    }
}
