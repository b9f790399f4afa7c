//! Distances between takes of one surface, which are the floor for a synthesis.
//!
//! A model fitted to one take need not come nearer to another take than the first take itself does.

use rayon::prelude::*;
use serde::Serialize;

use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::evaluation::evaluate::{DISTANCE_RANGE_HZ, Evaluation, rms};
use crate::fit;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

/// A trial, and how far another take of the same texture, speed and force is from it.
#[derive(Clone, Debug, Serialize)]
pub struct TakeDistance {
    /// The trial.
    pub file: String,
    /// The other take.
    pub other: String,
    /// Their texture.
    pub texture: String,
    /// Log-spectral distance of the other take from the trial, 30 to 1000 Hz, dB; none if one is silent.
    pub take_db: Option<f64>,
    /// Log-spectral distance of the synthesis, dB.
    pub synthesis_db: Option<f64>,
    /// Level of the other take over the trial's, dB.
    pub level_db: Option<f64>,
}

impl TakeDistance {
    /// Returns the distance of the synthesis beyond that of the other take, dB.
    pub fn excess_db(&self) -> Option<f64> {
        Some(self.synthesis_db? - self.take_db?)
    }
}

/// Compares every trial of `set` with the first of `others` that has its texture, speed and force; `evaluation` is of
/// `set`.
///
/// # Errors
/// A trial that has no other take, or a recording that cannot be used.
pub fn distances(
    set: &RecordingSet,
    others: &RecordingSet,
    evaluation: &Evaluation,
    reduction: Reduction,
) -> Result<Vec<TakeDistance>> {
    let pairs = set.trials.par_iter().zip(&evaluation.trials);
    pairs
        .map(|(trial, judged)| {
            let other = other_take(trial, others)?;
            let (a, b) = (
                fit::signal(trial, reduction)?.0,
                fit::signal(other, reduction)?.0,
            );
            let (low_hz, high_hz) = DISTANCE_RANGE_HZ;
            let rate_hz = f64::from(SAMPLE_RATE_HZ);
            let level_db = 20.0 * (rms(&b) / rms(&a)).log10();
            Ok(TakeDistance {
                file: judged.file.clone(),
                other: other.file.display().to_string(),
                texture: trial.texture.clone(),
                take_db: spectrum::log_spectral_distance_db(&a, &b, rate_hz, low_hz, high_hz),
                synthesis_db: judged.log_spectral_distance_db,
                level_db: Some(level_db).filter(|level| level.is_finite()),
            })
        })
        .collect()
}

fn other_take<'a>(trial: &Trial, others: &'a RecordingSet) -> Result<&'a Trial> {
    let same = |other: &&Trial| {
        other.texture == trial.texture
            && other.speed_mm_s == trial.speed_mm_s
            && other.force_n == trial.force_n
    };
    others.trials.iter().find(same).ok_or_else(|| {
        Error::file(
            &trial.file,
            format!(
                "has no other take: none of '{}' at {} mm/s and {} N among the others",
                trial.texture, trial.speed_mm_s, trial.force_n
            ),
        )
    })
}
