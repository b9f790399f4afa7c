//! Judgements of textures: against recordings, against removed nodes, against hard cases, and against their costs.
//!
//! Invariant: results are data. Nothing here draws or prints, and only the recordings that the frontier simulates are
//! written to files.

pub mod evaluate;
pub mod frontier;
pub mod held_out;
mod impulses;
pub mod leave_one_out;
pub mod listening;
pub mod liveliness;
mod loudness;
mod perception;
pub mod played;

/// Hard cases: models, grids, motions and states that break filters. The device's kernel plays them, and what it
/// promises for a normalised lattice is checked.
///
/// Each case is driven along its motion with noise at the level that the kernel always has, an RMS of an eighth of full
/// scale. Then the drive stops, and the motion continues until there is silence. The same is done with 8/3 of this
/// level, an RMS of a third of full scale. A third time the case begins without a drive, from a state with every signal
/// at full scale.
///
/// *Level* is measured relative to the same filter in float64 with the same noise. Its power is known exactly: a
/// normalised lattice has power one for noise of power one, whatever its rotations. So no minutes of averaging are
/// needed. *SNR* is relative to float64 with the same coefficients; it counts the damping of a line that rings for long
/// as noise. *Spectrum* is the largest difference, at any frequency, between the model as it was fitted and as it is
/// stored.
pub mod stress {
    pub mod models;
    mod outcome;
    mod run;

    pub use outcome::{Outcome, Rest, SNR_DB, SPECTRUM_DB};
    pub use run::run;
    pub(crate) use run::{lattice, play_with};
    /// The cases.
    pub use stylus_hard_cases as cases;
}

pub mod strokes;
pub mod summary;
pub mod table;
pub mod verdict;
