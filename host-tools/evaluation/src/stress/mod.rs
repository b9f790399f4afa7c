//! Hard cases: models, grids, motions and states that break filters, played by the device's kernel, with what it
//! promises of a normalised lattice checked.
//!
//! Each case is driven with noise, at the level that the kernel always has, an RMS of an eighth of full scale, along
//! its motion; then the drive stops, and the motion goes on until there is silence. Then it is driven with 8/3 of that,
//! an RMS of a third of full scale, and stopped again; and once more from a state that is full scale throughout.
//!
//! *Level* is measured against the same filter in float64 on the same noise, whose power is known exactly: a lattice's
//! is one for noise of power one, whatever its rotations. So it needs no minutes of averaging. *SNR* is against float64
//! with the same coefficients; it counts the damping of a line that rings for long as noise. *Spectrum* is the
//! largest difference, at any frequency, between the model as it was fitted and as it is stored.

pub mod cases;
pub mod models;
mod outcome;
pub mod player;
pub mod reference;
mod run;

pub use outcome::{
    LEVEL_DB, MEAN_STANDARD_ERRORS, Outcome, Rest, SNR_DB, SPECTRUM_DB, snr_limit_db,
    spectrum_limit_db,
};
pub use run::{play, play_with, run};
