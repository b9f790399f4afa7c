//! Trials without the lines of their texture: statistics and signals of what is left.

use model_format::SAMPLE_RATE_HZ;
use rayon::prelude::*;

use crate::dsp::autocorrelation::Autocorrelation;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::Result;

use super::analyse_texture;
use super::estimate::estimate;
use super::lines::separate;
use super::options::Options;
use super::trial::{Analysis, Signal};

/// Trials of texture `name`, with their indices in the set.
pub(super) fn of_texture<'s>(set: &'s RecordingSet, name: &str) -> (Vec<usize>, Vec<&'s Trial>) {
    let all = set.trials.iter().enumerate();
    all.filter(|(_, trial)| trial.texture == name).unzip()
}

/// Finds the lines of one texture, whose `trials` were `analysed`, and takes them out of the signals and of their
/// statistics: lags, bands and share. The power stays that of the whole signal.
pub(super) fn separate_lines(
    trials: &[&Trial],
    analysed: &mut [(Analysis, Signal)],
    options: &Options,
    max_order: usize,
) {
    let mut signals: Vec<Vec<f64>> = trials
        .iter()
        .zip(analysed.iter_mut())
        .map(|(trial, (analysis, signal))| {
            if can_have_lines(trial, analysis, options) {
                std::mem::take(&mut signal.samples)
            } else {
                Vec::new()
            }
        })
        .collect();
    let speeds_mm_s: Vec<f64> = trials.iter().map(|trial| trial.line_speed_mm_s()).collect();
    let shares = separate(&speeds_mm_s, &mut signals, None, options.lines);
    let work = analysed.par_iter_mut().zip(signals).zip(shares);
    work.for_each(|(((analysis, signal), rest), share)| {
        if !rest.is_empty() {
            signal.samples = rest;
        }
        if share.amplitudes_m_s2.iter().flatten().any(|&a| a > 0.0) {
            let plain = Autocorrelation::of(&signal.samples, max_order);
            let estimate = estimate(&signal.samples, plain, analysis.slow.cut_hz);
            (analysis.lags, analysis.bands) = (estimate.lags, estimate.bands);
        }
        analysis.lines = share;
    });
}

/// Returns whether lines are sought in a trial: it sounds, is kept, and has no gap that a phase would break at.
pub(super) fn can_have_lines(trial: &Trial, analysis: &Analysis, options: &Options) -> bool {
    let is_dropped = || {
        let names = analysis.verdicts.iter().map(super::Verdict::name);
        names
            .into_iter()
            .any(|name| options.drop.iter().any(|dropped| dropped == name))
    };
    let half_a_sample_s = 0.5 / f64::from(SAMPLE_RATE_HZ);
    trial.is_in_motion_and_contact()
        && !analysis.is_silent()
        && analysis.cut_s < half_a_sample_s
        && !is_dropped()
}

/// Reads the trials of `set` that are `used`, and returns their signals without lines, m/s²; empty ones for the others.
///
/// # Errors
/// A recording that cannot be used.
pub fn signals_without_lines(
    set: &RecordingSet,
    used: &[bool],
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Vec<Vec<f64>>> {
    let mut signals = vec![Vec::new(); set.trials.len()];
    for (_, mut members) in set.by_texture() {
        members.retain(|&member| used[member]);
        let trials: Vec<&Trial> = members.iter().map(|&member| &set.trials[member]).collect();
        let analysed = analyse_texture(&trials, options, 1, &progress)?;
        for (member, (_, signal)) in members.into_iter().zip(analysed) {
            signals[member] = signal.samples;
        }
    }
    Ok(signals)
}
