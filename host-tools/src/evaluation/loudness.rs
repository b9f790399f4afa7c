//! Loudest events: what the stylus plays beside the recordings around its place on the grid, in windows of 5 ms.
//!
//! A single event changes neither a spectrum nor a median over windows. Events vary, so that a synthesis is compared
//! with the loudest of all recordings that are up to one step of speed and force away, and its target, the other
//! recording, is compared in the same way.

use std::collections::BTreeMap;

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;

use crate::dsp::sums::sliding;

/// Duration of a window, s.
const WINDOW_S: f64 = 0.005;

/// Ratio to the recordings, beyond what recordings have to each other, from which on events are too strong.
pub const TOO_STRONG: f64 = 1.5;

/// The loudest 5 ms of a trial's signals, as RMS, m/s².
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialLoudness {
    /// Of the recording that judges.
    pub recorded_m_s2: f64,
    /// Of the recordings that judge this trial and those up to one step of speed and force away.
    pub around_m_s2: f64,
    /// Of the synthesis.
    pub synthesised_m_s2: f64,
    /// Of the other recording.
    pub other_m_s2: f64,
    /// The synthesis over the recordings around it, beyond what it is louder as a whole.
    pub times: f64,
    /// The other recording over the recordings around it.
    pub times_other: f64,
}

impl TrialLoudness {
    /// Measures a trial's signals, of which none is silent; the recordings around it are its own until [`set_around`].
    pub(super) fn of(judged: &[Vec<f64>], synthesised: &[f64], other: &[Vec<f64>]) -> Self {
        let of_blocks = |blocks: &[Vec<f64>]| blocks.iter().map(|b| loudest(b)).fold(0.0, f64::max);
        let [recorded_m_s2, other_m_s2] = [judged, other].map(of_blocks);
        let synthesised_m_s2 = loudest(synthesised);
        let power = mean_square(judged.iter().flatten());
        let level = (mean_square(synthesised.iter()) / power).sqrt();
        Self {
            recorded_m_s2,
            around_m_s2: recorded_m_s2,
            synthesised_m_s2,
            other_m_s2,
            times: synthesised_m_s2 / recorded_m_s2 / level.max(1.0),
            times_other: other_m_s2 / recorded_m_s2,
        }
    }
}

fn mean_square<'a>(samples: impl Iterator<Item = &'a f64>) -> f64 {
    let (sum, count) = samples.fold((0.0, 0u32), |(sum, count), x| (sum + x * x, count + 1));
    sum / f64::from(count.max(1))
}

/// RMS of the loudest window, m/s².
fn loudest(signal: &[f64]) -> f64 {
    let samples = (WINDOW_S * f64::from(SAMPLE_RATE_HZ)).round() as usize;
    let squares: Vec<f64> = signal.iter().map(|x| x * x).collect();
    let sums = sliding(&squares, &vec![1.0; samples]);
    (sums.into_iter().fold(0.0, f64::max) / samples as f64).sqrt()
}

/// The loudness of a trial at a place.
pub(super) struct Placed<'a> {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// What [`set_around`] changes.
    pub loudness: &'a mut TrialLoudness,
}

/// Takes the recordings around each of a texture's `trials` into account.
pub(super) fn set_around(trials: &mut [Placed<'_>]) {
    let (speed, force) = (
        ranks(trials, |t| t.speed_mm_s),
        ranks(trials, |t| t.force_n),
    );
    let places: Vec<(usize, usize)> = speed.into_iter().zip(force).collect();
    let mut loudest: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for (trial, place) in trials.iter().zip(&places) {
        let most = loudest.entry(*place).or_default();
        *most = most.max(trial.loudness.recorded_m_s2);
    }
    for (trial, (speed, force)) in trials.iter_mut().zip(places) {
        let own = &mut *trial.loudness;
        let near = |at: usize| at.saturating_sub(1)..=at + 1;
        let around = near(speed).flat_map(|speed| near(force).map(move |force| (speed, force)));
        let around = around.filter_map(|place| loudest.get(&place).copied());
        own.around_m_s2 = around.fold(own.recorded_m_s2, f64::max);
        let share = own.recorded_m_s2 / own.around_m_s2;
        own.times *= share;
        own.times_other *= share;
    }
}

/// The rank of each trial's value among the values of all.
fn ranks(trials: &[Placed<'_>], of: fn(&Placed<'_>) -> f64) -> Vec<usize> {
    let mut steps: Vec<f64> = trials.iter().map(of).collect();
    steps.sort_by(f64::total_cmp);
    steps.dedup();
    let rank = |trial: &Placed<'_>| steps.partition_point(|step| *step < of(trial));
    trials.iter().map(rank).collect()
}

/// The loudest 5 ms of a texture's trials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Loudness {
    /// Largest ratio of a synthesis to the recordings around it, beyond what it is louder as a whole.
    pub times: f64,
    /// Largest ratio of another recording to the recordings around it.
    pub times_other: f64,
    /// Trials in which the ratio is [`TOO_STRONG`] times that of other recordings, or 1 if these have less.
    pub trials_too_strong: usize,
}

impl Loudness {
    /// The loudness of a texture's trials; `None` of none.
    pub(super) fn of(trials: impl Iterator<Item = TrialLoudness>) -> Option<Self> {
        let trials: Vec<TrialLoudness> = trials.collect();
        let most = |of: fn(&TrialLoudness) -> f64| trials.iter().map(of).reduce(f64::max);
        let times_other = most(|own| own.times_other)?;
        let bound = TOO_STRONG * times_other.max(1.0);
        Some(Self {
            times: most(|own| own.times)?,
            times_other,
            trials_too_strong: trials.iter().filter(|own| own.times > bound).count(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::test_signals::{near, noise};

    #[test]
    fn a_click_counts_beyond_the_level_and_beside_the_recordings_up_to_a_step_away() {
        let recorded = noise(1, 10_000);
        let mut clicking: Vec<f64> = noise(2, 50_000);
        clicking[20_000..20_025].fill(20.0);
        let judged = [recorded.clone()];
        let click = TrialLoudness::of(&judged, &clicking, &judged);
        near(click.synthesised_m_s2, 20.0, 1e-9);
        near(click.times, 20.0 / click.recorded_m_s2, 0.1 * click.times);
        near(click.times_other, 1.0, 1e-9);
        // All of it is too loud, which its level says.
        let loud: Vec<f64> = recorded.iter().map(|x| 4.0 * x).collect();
        near(TrialLoudness::of(&judged, &loud, &judged).times, 1.0, 1e-9);

        let events = [vec![0.5; 100], vec![10.0; 25], vec![0.5; 100]].concat();
        let eventful = TrialLoudness::of(&[events.clone()], &recorded, &[events]);
        let speeds_mm_s = [40.0, 60.0, 80.0];
        let mut of_trials = [click, click, eventful];
        let placed = of_trials.iter_mut().zip(speeds_mm_s);
        let mut placed: Vec<Placed<'_>> = placed
            .map(|(loudness, speed_mm_s)| Placed {
                speed_mm_s,
                force_n: 1.0,
                loudness,
            })
            .collect();
        set_around(&mut placed);
        assert_eq!(of_trials[0], click);
        near(of_trials[1].around_m_s2, 10.0, 1e-9);
        near(of_trials[1].times, 2.0, 0.2);
        let all = Loudness::of(of_trials.into_iter()).unwrap();
        assert_eq!((all.times, all.trials_too_strong), (click.times, 2));
        assert_eq!(Loudness::of(std::iter::empty()), None);
    }
}
