//! The hard cases at an order: does a structure hold what the stylus promises of its lattice, and if not, how bad does
//! it get.

use serde::Serialize;

use stylus_costs::Structure;

use super::players::player_of;
use crate::stress::cases::Case;
use crate::stress::{self, Outcome};
use crate::support::error::Result;

/// The end of a case, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All that is promised held.
    Held,
    /// A limit cycle below 1 % of full scale remains when the drive stops.
    Residue,
    /// Level, noise or spectrum is outside its promised bound, or the state's norm grows.
    Inaccurate,
    /// The signal was at full scale while the structure was driven as it is meant to be.
    Saturates,
    /// The structure cannot hold the models.
    Refused,
    /// The signal goes on loudly for ever when the drive stops.
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
    /// The worst end of a case.
    pub worst: Verdict,
    /// Name of the case with the worst end; empty if all cases held.
    pub worst_case: String,
}

impl std::fmt::Display for HardCases {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.held, self.cases)
    }
}

/// A share of full scale that is loud.
const LOUD: f64 = 0.01;

/// `case` with models of at most `order`.
pub fn of_order(case: &Case, order: usize) -> Case {
    let mut case = case.clone();
    for (model, _) in &mut case.models {
        model.reflection.truncate(order);
    }
    case
}

/// Plays `case` by `structure`.
///
/// # Errors
/// A lattice that makes no library, which none does.
pub fn play(case: &Case, structure: Structure) -> Result<Verdict> {
    let mut case = case.clone();
    // The reference is a lattice: a direct form's signals have other scales.
    case.with_reference &= !structure.is_direct();
    let played = stress::play_with(&case, |texture| player_of(structure, texture).ok())?;
    let Some(mut outcome) = played else {
        return Ok(Verdict::Refused);
    };
    if structure.is_direct() {
        // A state that grows by a little is not worth a word.
        for rest in [
            &mut outcome.stopped,
            &mut outcome.overdriven,
            &mut outcome.glitched,
        ] {
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
    if endless().any(|rest| rest.left > LOUD) {
        Verdict::Latches
    } else if outcome.saturated > 0 {
        Verdict::Saturates
    } else if outcome.broken().is_empty() {
        Verdict::Held
    } else if endless().next().is_some() && outcome.broken().len() == endless().count() {
        Verdict::Residue
    } else {
        Verdict::Inaccurate
    }
}

/// Sums up the verdicts of cases with their names, at least one.
pub fn summarise(verdicts: &[(&str, Verdict)]) -> HardCases {
    let held = verdicts
        .iter()
        .filter(|(_, verdict)| *verdict == Verdict::Held);
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
