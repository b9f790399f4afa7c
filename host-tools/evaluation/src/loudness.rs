//! Loudest events, in windows of 5 ms: the synthesis compared with the recordings around its place on the grid.
//!
//! A single event changes neither a spectrum nor a median over windows. Because events vary, a synthesis is compared
//! with the loudest of the recordings that are up to one step of speed and force away. The target, which is the other
//! recording, is compared in the same way.

use std::collections::BTreeMap;

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;
use stylus_dsp::sums::{sliding, upper_median};

/// Duration of a window, s.
const WINDOW_S: f64 = 0.005;

/// Ratio to the recordings, relative to the ratio between recordings, above which events are too strong.
///
/// Simulated textures with impulses as near as those of other recordings reach 1.6 in the loudest of 120 trials, with
/// syntheses ten times as long as the recordings.
pub const TOO_STRONG: f64 = 2.0;

/// The loudest 5 ms of a trial's signals, as RMS, m/s².
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialLoudness {
    /// Loudest 5 ms of the recording that judges, as RMS, m/s².
    pub recorded_m_s2: f64,
    /// Loudest 5 ms of the synthesis, as RMS, m/s².
    pub synthesised_m_s2: f64,
    /// Loudest 5 ms of the other recording, as RMS, m/s².
    pub other_m_s2: f64,
    /// Loudest 5 ms of the library as it is, as RMS, m/s², if blocks judge models that were fitted to the blocks
    /// between.
    pub library_m_s2: Option<f64>,
    /// The larger of two ratios: of the synthesis to the judging recordings around it, and of the library to all
    /// recordings around it. Both are divided by the factor by which the synthesis is louder as a whole.
    pub times: f64,
    /// Ratio of the loudest 5 ms of the other recording to the loudest 5 ms of the judging recordings around it.
    pub times_other: f64,
    /// Ratio of the median window of the synthesis to the median window of the recording. Single events do not change
    /// it.
    #[serde(skip)]
    level: f64,
}

impl TrialLoudness {
    /// Measures a trial's signals. Until [`set_around`], they are compared with the trial's own recordings only.
    /// Returns `None` if the judge is silent or has no window.
    pub(super) fn of(
        judged: &[Vec<f64>],
        synthesised: &[f64],
        other: &[Vec<f64>],
        library: Option<&[f64]>,
    ) -> Option<Self> {
        let of_blocks = |blocks: &[Vec<f64>]| Windows::of(blocks.iter().map(Vec::as_slice));
        let of_signal = |signal: &[f64]| Windows::of(std::iter::once(signal));
        let (recorded, synthesised) = (of_blocks(judged), of_signal(synthesised));
        let mut own = Self {
            recorded_m_s2: recorded.loudest_m_s2,
            synthesised_m_s2: synthesised.loudest_m_s2,
            other_m_s2: of_blocks(other).loudest_m_s2,
            library_m_s2: library.map(|own| of_signal(own).loudest_m_s2),
            times: 0.0,
            times_other: 0.0,
            level: synthesised.median_m_s2 / recorded.median_m_s2,
        };
        own.compare(Around::of(&own));
        // A silent judge would make the ratios infinite.
        (own.recorded_m_s2 > 0.0).then_some(own)
    }

    /// Compares with the recordings around.
    fn compare(&mut self, around: Around) {
        // The library was fitted to all blocks, so that it may be as loud as any of them.
        let library = self.library_m_s2.unwrap_or(0.0) / around.all_m_s2;
        let synthesis = self.synthesised_m_s2 / around.judges_m_s2;
        // A level below 1 would raise the events of a synthesis that is too soft.
        self.times = synthesis.max(library) / self.level.max(1.0);
        self.times_other = self.other_m_s2 / around.judges_m_s2;
    }
}

/// The loudest 5 ms of recordings, as RMS, m/s².
#[derive(Clone, Copy, Default)]
struct Around {
    /// Loudest 5 ms of the recordings that judge.
    judges_m_s2: f64,
    /// Loudest 5 ms of all recordings, those that judge and the others.
    all_m_s2: f64,
}

impl Around {
    fn of(trial: &TrialLoudness) -> Self {
        Self {
            judges_m_s2: trial.recorded_m_s2,
            all_m_s2: trial.recorded_m_s2.max(trial.other_m_s2),
        }
    }

    fn with(self, other: Self) -> Self {
        Self {
            judges_m_s2: self.judges_m_s2.max(other.judges_m_s2),
            all_m_s2: self.all_m_s2.max(other.all_m_s2),
        }
    }
}

/// RMS of windows, m/s².
#[derive(Default)]
struct Windows {
    loudest_m_s2: f64,
    median_m_s2: f64,
}

impl Windows {
    fn of<'a>(blocks: impl Iterator<Item = &'a [f64]>) -> Self {
        let samples = (WINDOW_S * f64::from(SAMPLE_RATE_HZ)).round() as usize;
        // Block by block, so that no window crosses the join of two blocks.
        let energies: Vec<f64> = blocks
            .flat_map(|block| {
                let squares: Vec<f64> = block.iter().map(|x| x * x).collect();
                sliding(&squares, &vec![1.0; samples])
            })
            .collect();
        let Some(median) = upper_median(&energies) else {
            return Self::default();
        };
        let loudest = energies.iter().copied().fold(0.0, f64::max);
        let rms = |energy: f64| (energy / samples as f64).sqrt();
        Self {
            loudest_m_s2: rms(loudest),
            median_m_s2: rms(median),
        }
    }
}

/// The loudness of a trial at a place.
pub(super) struct Placed<'a> {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Loudness, which [`set_around`] changes.
    pub loudness: &'a mut TrialLoudness,
}

/// Compares each of a texture's `trials` with the recordings up to one step of speed and force away.
pub(super) fn set_around(trials: &mut [Placed<'_>]) {
    // A step is to the next recorded value, however far away it is.
    let (speed, force) = (ranks(trials, |t| t.speed_mm_s), ranks(trials, |t| t.force_n));
    let places: Vec<(usize, usize)> = speed.into_iter().zip(force).collect();
    let mut loudest: BTreeMap<(usize, usize), Around> = BTreeMap::new();
    for (trial, place) in trials.iter().zip(&places) {
        let here = loudest.entry(*place).or_default();
        *here = here.with(Around::of(trial.loudness));
    }
    for (trial, (speed, force)) in trials.iter_mut().zip(places) {
        let near = |at: usize| at.saturating_sub(1)..=at + 1;
        let around = near(speed)
            .flat_map(|speed| near(force).map(move |force| (speed, force)))
            .filter_map(|place| loudest.get(&place).copied())
            .fold(Around::default(), Around::with);
        trial.loudness.compare(around);
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
    /// Largest ratio of a synthesis to the recordings around it, divided by the factor by which the synthesis is louder
    /// as a whole.
    pub times: f64,
    /// Largest ratio of another recording to the loudest of the recordings around its place, by their loudest 5 ms.
    pub times_other: f64,
    /// Number of trials whose ratio exceeds [`TOO_STRONG`] times the ratio of other recordings, or times 1 if that is
    /// smaller.
    pub trials_too_strong: usize,
}

impl Loudness {
    /// Returns the loudness of a texture's trials; `None` without trials.
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
    use test_helpers::{near, noise};

    #[test]
    fn a_click_counts_beyond_the_level_and_beside_the_recordings_up_to_a_step_away() {
        let recorded = noise(1, 10_000);
        let mut clicking: Vec<f64> = noise(2, 50_000);
        clicking[20_000..20_025].fill(20.0);
        let judged = [recorded.clone()];
        let click = TrialLoudness::of(&judged, &clicking, &judged, None).unwrap();
        near(click.synthesised_m_s2, 20.0, 1e-9);
        near(click.times, 20.0 / click.recorded_m_s2, 0.02 * click.times);
        near(click.times_other, 1.0, 1e-9);
        // The whole signal is too loud. Its level shows this, so it does not count as an event.
        let loud: Vec<f64> = recorded.iter().map(|x| 4.0 * x).collect();
        let level = TrialLoudness::of(&judged, &loud, &judged, None).unwrap();
        near(level.times, 1.0, 1e-9);
        // The library's events count, even if the models that blocks judge do not have them.
        let of_library = TrialLoudness::of(&judged, &recorded, &judged, Some(&clicking)).unwrap();
        near(of_library.times, click.times, 0.05 * click.times);

        let events = [vec![0.5; 100], vec![8.0; 25], vec![0.5; 100]].concat();
        let events = [events];
        let eventful = TrialLoudness::of(&events, &recorded, &events, None).unwrap();
        let speeds_mm_s = [40.0, 60.0, 80.0];
        let mut of_trials = [click, click, eventful];
        let mut placed: Vec<Placed<'_>> = of_trials
            .iter_mut()
            .zip(speeds_mm_s)
            .map(|(loudness, speed_mm_s)| Placed {
                speed_mm_s,
                force_n: 1.0,
                loudness,
            })
            .collect();
        set_around(&mut placed);
        assert_eq!(of_trials[0], click);
        near(of_trials[1].times, 2.5, 0.1);
        let all = Loudness::of(of_trials.into_iter()).unwrap();
        assert_eq!((all.times, all.trials_too_strong), (click.times, 2));
        assert_eq!(Loudness::of(std::iter::empty()), None);
        assert_eq!(TrialLoudness::of(&[vec![1.0; 9]], &recorded, &[], None), None);
    }
}
