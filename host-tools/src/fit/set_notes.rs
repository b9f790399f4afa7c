//! Notes on a whole set before its textures are fitted: what its list leaves open, and values that are likely to be
//! mistaken.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::recording::{RecordingSet, Trial, holds_integers};
use crate::support::file_name;

use super::trial_report::TrialReport;

/// Force that is more than a hand holds a tool to a surface with, N; grams taken for newtons are above.
const LARGE_FORCE_N: f64 = 20.0;

/// Speed that is more than a hand strokes or a drum turns with, mm/s.
const LARGE_SPEED_MM_S: f64 = 2000.0;

/// Speed that is less than anything is stroked with, mm/s; metres per second taken for millimetres are below.
const SMALL_SPEED_MM_S: f64 = 1.0;

/// Most pairs of names that are told.
const MOST_PAIRS: usize = 5;

/// Returns the notes on `set`, whose trials have these `reports`, one line each.
pub(super) fn of(set: &RecordingSet, reports: &[TrialReport]) -> Vec<String> {
    let mut notes = Vec::new();
    notes.extend(missing_scale(set, reports));
    notes.extend(alike_names(set));
    notes.extend(doubtful_motions(&set.trials));
    notes
}

/// Returns true for a trial whose samples were integers.
fn are_integers(trial: &Trial) -> bool {
    match &trial.held {
        Some(held) => held.are_integers(),
        None => holds_integers(&trial.file),
    }
}

/// Returns a note on recordings of integers whose list does not tell what their full scale is.
fn missing_scale(set: &RecordingSet, reports: &[TrialReport]) -> Option<String> {
    let trials: Vec<(&Trial, &TrialReport)> = set.trials.iter().zip(reports).collect();
    let levels: Vec<f64> = trials
        .par_iter()
        .filter(|(trial, _)| trial.scale_m_s2.is_none() && are_integers(trial))
        .map(|(_, report)| report.rms_m_s2)
        .collect();
    if levels.is_empty() {
        return None;
    }
    let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = levels.iter().copied().fold(0.0, f64::max);
    let [least, largest] = [least, largest].map(|level| format!("{level:.3}"));
    let level = if least == largest {
        format!("a level of {least}")
    } else {
        format!("levels of {least} to {largest}")
    };
    Some(format!(
        "{} of {} recordings hold integers, and no scale tells the acceleration of their full scale: 1 m/s² is taken, \
         which makes {level} m/s² RMS; give scale_m_s2 in the list or --scale, such as 98.1 \
         for an accelerometer of ±10 g",
        levels.len(),
        set.trials.len()
    ))
}

/// Returns notes on textures whose names differ in the case of letters only.
fn alike_names(set: &RecordingSet) -> Vec<String> {
    let mut names: HashMap<String, &str> = HashMap::new();
    let mut notes = Vec::new();
    for name in set.textures() {
        let earlier = *names.entry(file_name::folded(name)).or_insert(name);
        if earlier != name {
            notes.push(format!(
                "textures {earlier:?} and {name:?} differ in the case of letters only, and become two: rename one in \
                 the list if they are meant to be one"
            ));
        }
    }
    notes.truncate(MOST_PAIRS);
    notes
}

/// Returns notes on speeds and forces that are likely to be in another unit.
fn doubtful_motions(trials: &[Trial]) -> Vec<String> {
    let largest = |of: fn(&Trial) -> f64| trials.iter().map(of).fold(0.0, f64::max);
    let (speed, force) = (largest(|t| t.speed_mm_s), largest(|t| t.force_n));
    let mut notes = Vec::new();
    if speed > LARGE_SPEED_MM_S {
        notes.push(format!(
            "speeds reach {speed} mm/s, and hands and drums stay below {LARGE_SPEED_MM_S}: check speed_mm_s"
        ));
    }
    if speed > 0.0 && speed < SMALL_SPEED_MM_S {
        notes.push(format!(
            "no speed is above {speed} mm/s: are they in m/s? give speed_mm_s in mm/s"
        ));
    }
    if force > LARGE_FORCE_N {
        notes.push(format!(
            "forces reach {force} N, and hands stay below {LARGE_FORCE_N}: are they in grams? give force_n in newtons"
        ));
    }
    notes
}
