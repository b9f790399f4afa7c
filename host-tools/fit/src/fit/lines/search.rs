//! The search for what moves with speed: narrow peaks at one wavelength over several speeds.
//!
//! A peak at the frequency f of a trial at the speed v may belong to a wavelength v/f, which predicts peaks at other
//! frequencies at other speeds, or to the frequency f, which predicts peaks at the same one: hum, a motor, a resonance.
//! The hypothesis that explains its trials best is taken first, what it explains is removed from the recordings, and
//! the search goes on in what is left. So a line explains its own peaks before they can be taken for something else,
//! and a harmonic of the mains that happens to lie at v/λ is gone before λ is asked for.
//!
//! # The test's level
//!
//! A speed shows a hypothesis if the chance of the highest peak within its window is below a bound b, corrected for the
//! window's cells and for the number of trials at that speed. A wavelength is taken if at least half of the speeds at
//! which it could be seen, and two, show it. In noise the expected share of speeds that do is at most b, so by Markov's
//! inequality half of them do with a chance of at most 2b, *however the trials depend on each other*: they are strokes
//! over one surface, whose irregularities return. With M wavelengths that can be told apart, b = level / 2M holds the
//! level for a search, and half of it that of a texture, which is searched twice.

use std::borrow::Cow;
use std::ops::ControlFlow;

use model_format::SAMPLE_RATE_HZ;

use super::peaks::{LineSpectrum, Peak};
use super::track::{amplitudes, at_even_places, followed, refined, steady_turns, subtract, wave};
use crate::dsp::sums::upper_median;

/// Chance of any line in a texture that has none.
pub(super) const LEVEL: f64 = 1e-3;

/// Searches of one texture, with different errors of the listed speeds, which share the level.
const SEARCHES: f64 = 2.0;

/// Frequencies of lines, Hz: from above the hand's motion to where the device fades them out.
pub(super) const LOWEST_HZ: f64 = 12.0;
pub(super) const HIGHEST_HZ: f64 = 2200.0;

/// Error of a peak's place in noise, cells.
const PLACE_CELLS: f64 = 1.0;

/// Chance above which a peak makes no hypothesis of its own.
const LN_HYPOTHESIS_CHANCE: f64 = -14.0;

/// Evidence of one speed, as minus the logarithm of its chance, beyond which more says nothing: a hypothesis is judged
/// by how many speeds show it.
const MOST_EVIDENCE: f64 = 60.0;

/// Lines that are removed at most before the search ends: those of place, and those of time.
const MOST_REMOVED: usize = 40;

/// Harmonics of a line that are looked for by name.
pub(super) const HARMONICS: u32 = 8;

/// One trial as the search hears it.
#[derive(Clone)]
pub(super) struct Heard<'s> {
    /// Speed of the trial as listed, mm/s.
    pub speed_mm_s: f64,
    /// Actual speed of the trial over the listed one, as far as lines have told it.
    pub speed_ratio: Option<f64>,
    /// Samples of the trial without the lines that were removed.
    signal: Cow<'s, [f64]>,
    peaks: Vec<Peak>,
    cell_hz: f64,
    /// Least background, by the spectrum before anything was removed.
    floor: f64,
}

impl<'s> Heard<'s> {
    /// Hears `signal`; `None` if it is too short or silent.
    pub(super) fn of(speed_mm_s: f64, signal: &'s [f64]) -> Option<Self> {
        let spectrum = LineSpectrum::of(signal)?;
        Some(Self {
            speed_mm_s,
            speed_ratio: None,
            signal: Cow::Borrowed(signal),
            peaks: spectrum.peaks(LOWEST_HZ, HIGHEST_HZ),
            cell_hz: spectrum.cell_hz,
            floor: spectrum.floor,
        })
    }

    fn hear_again(&mut self) {
        let spectrum = LineSpectrum::of(&self.signal);
        self.peaks = spectrum.map_or_else(Vec::new, |mut spectrum| {
            spectrum.floor = spectrum.floor.max(self.floor);
            spectrum.peaks(LOWEST_HZ, HIGHEST_HZ)
        });
    }

    /// Highest peak over its background within `within_hz` of `frequency_hz`, and the logarithm of its p-value,
    /// corrected for the window's cells (Bonferroni).
    fn peak_near(&self, frequency_hz: f64, within_hz: f64) -> Option<(Peak, f64)> {
        let first = self
            .peaks
            .partition_point(|peak| peak.frequency_hz < frequency_hz - within_hz);
        let near = self.peaks[first..]
            .iter()
            .take_while(|peak| peak.frequency_hz <= frequency_hz + within_hz);
        let peak = *near.min_by(|a, b| a.ln_chance.total_cmp(&b.ln_chance))?;
        let cells = (2.0 * within_hz / self.cell_hz).max(1.0);
        Some((peak, peak.ln_chance + cells.ln()))
    }

    /// Removes the sine at `frequency_hz`, and returns its exact frequency.
    fn remove(&mut self, frequency_hz: f64) -> f64 {
        let exact_hz = refined(&self.signal, frequency_hz, self.cell_hz);
        let wave = wave(steady_turns(exact_hz, self.signal.len()).into_iter());
        let amplitude = amplitudes(
            &self.signal,
            std::slice::from_ref(&(0..self.signal.len())),
            std::slice::from_ref(&wave),
        )[0];
        subtract(self.signal.to_mut(), amplitude, &wave);
        self.hear_again();
        exact_hz
    }

    /// Brings the samples to even places, if the phase of the sine at `frequency_hz` tells that the speed wandered. So
    /// other lines of the surface are as narrow as their first one, and none of them leaves a residue for a line.
    fn straighten(&mut self, frequency_hz: f64) {
        let exact_hz = refined(&self.signal, frequency_hz, self.cell_hz);
        // Places in wavelengths.
        let mut places = steady_turns(exact_hz, self.signal.len());
        if followed(&self.signal, &mut places, 1.0) {
            let last = places.len() - 1;
            let step = (places[last] - places[0]) / last as f64;
            self.signal = at_even_places(&self.signal, &places, step).into();
        }
    }

    fn actual_speed_mm_s(&self) -> f64 {
        self.speed_mm_s * self.speed_ratio.unwrap_or(1.0)
    }
}

/// An explanation of peaks in several trials.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hypothesis {
    /// Wavelength, mm.
    Place(f64),
    /// Frequency, Hz.
    Time(f64),
}

/// A line that is tied to position, as found.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    /// Wavelength, mm, as the trials' median.
    pub wavelength_mm: f64,
    /// Index of each trial that shows the line, and the line's frequency there, Hz.
    pub shown_by: Vec<(usize, f64)>,
    /// Numbers of the speeds that show the line, and of those at which it could be seen.
    pub speeds: (usize, usize),
}

/// The outcome of a search.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Outcome {
    /// Lines tied to position, those first that explain most.
    pub lines: Vec<Found>,
    /// Frequencies that stay while the speed changes, Hz.
    pub time_locked_hz: Vec<f64>,
}

/// Support of a hypothesis.
struct Support {
    hypothesis: Hypothesis,
    /// Mean evidence of a speed, none of which counts beyond [`MOST_EVIDENCE`].
    score: f64,
    /// Sum of all evidence.
    evidence: f64,
    shown_by: Vec<(usize, Peak)>,
    speeds: (usize, usize),
}

impl Support {
    /// Returns whether this support is better than `other`: by its score; of equal ones, that of time, and then the one
    /// with more evidence.
    fn is_better(&self, other: &Self) -> bool {
        let is_of_time = |own: &Self| matches!(own.hypothesis, Hypothesis::Time(_));
        let key = |own: &Self| (own.score, is_of_time(own), own.evidence);
        key(self) > key(other)
    }
}

/// The search over the trials of one texture.
pub(super) struct Search<'s> {
    pub trials: Vec<Heard<'s>>,
    /// Relative error of a listed speed.
    pub speed_tolerance: f64,
    /// Most lines that are wanted.
    pub most_lines: usize,
}

impl Search<'_> {
    /// Finds lines until nothing more stands out.
    pub(super) fn run(mut self) -> Outcome {
        let mut outcome = Outcome::default();
        for _ in 0..MOST_REMOVED {
            if self.step(&mut outcome).is_break() || outcome.lines.len() == self.most_lines {
                break;
            }
        }
        outcome
    }

    fn step(&mut self, outcome: &mut Outcome) -> ControlFlow<()> {
        let known: Vec<f64> = outcome
            .lines
            .iter()
            .map(|line| line.wavelength_mm)
            .collect();
        let Some(support) = self.best(&known) else {
            return ControlFlow::Break(());
        };
        match support.hypothesis {
            Hypothesis::Place(wavelength_mm) => {
                let shown_by = self.remove_line(wavelength_mm, &support);
                let of_trial =
                    |&(trial, hz): &(usize, f64)| self.trials[trial].actual_speed_mm_s() / hz;
                let of_trials: Vec<f64> = shown_by.iter().map(of_trial).collect();
                outcome.lines.push(Found {
                    wavelength_mm: upper_median(&of_trials).unwrap_or(wavelength_mm),
                    shown_by,
                    speeds: support.speeds,
                });
            }
            Hypothesis::Time(frequency_hz) => {
                for (trial, peak) in &support.shown_by {
                    self.trials[*trial].remove(peak.frequency_hz);
                }
                outcome.time_locked_hz.push(frequency_hz);
            }
        }
        ControlFlow::Continue(())
    }

    /// Removes a line from the trials that show it, and returns its frequency in each.
    fn remove_line(&mut self, wavelength_mm: f64, support: &Support) -> Vec<(usize, f64)> {
        let mut shown_by = Vec::with_capacity(support.shown_by.len());
        for (index, peak) in &support.shown_by {
            let trial = &mut self.trials[*index];
            trial.straighten(peak.frequency_hz);
            let exact_hz = trial.remove(peak.frequency_hz);
            // The first line tells the speed for those after it.
            let listed_hz = trial.speed_mm_s / wavelength_mm;
            trial.speed_ratio.get_or_insert(exact_hz / listed_hz);
            shown_by.push((*index, exact_hz));
        }
        shown_by
    }

    /// The support of the best acceptable hypothesis.
    fn best(&self, known_mm: &[f64]) -> Option<Support> {
        let longest = self.trials.iter().map(|trial| trial.signal.len()).max()?;
        let longest_s = longest as f64 / f64::from(SAMPLE_RATE_HZ);
        // Wavelengths that can be told apart: M = 2 f T, two per cell up to the highest frequency.
        let ln_bound = (LEVEL / SEARCHES / (2.0 * 2.0 * HIGHEST_HZ * longest_s)).ln();
        // Harmonics of what is known are few, those of at most eight lines, and so need less evidence.
        let ln_harmonic_bound = (LEVEL / SEARCHES / (2.0 * f64::from(HARMONICS) * 8.0)).ln();
        let unknown = self.hypotheses().into_iter().map(|h| (h, ln_bound));
        let harmonics = known_mm.iter().flat_map(|wavelength| {
            let of = move |n| Hypothesis::Place(wavelength / f64::from(n));
            (2..=HARMONICS).map(of).map(|h| (h, ln_harmonic_bound))
        });
        let supported = unknown
            .chain(harmonics)
            .filter_map(|(hypothesis, ln_bound)| self.support(hypothesis, ln_bound, known_mm));
        supported.reduce(|best, next| if next.is_better(&best) { next } else { best })
    }

    /// The hypotheses that single peaks suggest, each about once.
    fn hypotheses(&self) -> Vec<Hypothesis> {
        let mut all: Vec<Hypothesis> = Vec::new();
        for trial in &self.trials {
            for peak in &trial.peaks {
                if peak.ln_chance < LN_HYPOTHESIS_CHANCE {
                    all.push(Hypothesis::Place(
                        trial.actual_speed_mm_s() / peak.frequency_hz,
                    ));
                    all.push(Hypothesis::Time(peak.frequency_hz));
                }
            }
        }
        all
    }

    /// Support of the trials for `hypothesis`; `None` if it is not acceptable.
    fn support(&self, hypothesis: Hypothesis, ln_bound: f64, known_mm: &[f64]) -> Option<Support> {
        let seen = self.trials.iter().enumerate().filter_map(|(index, trial)| {
            let (frequency_hz, tolerance) = match hypothesis {
                Hypothesis::Time(frequency_hz) => (frequency_hz, 0.0),
                Hypothesis::Place(wavelength_mm) => (
                    trial.actual_speed_mm_s() / wavelength_mm,
                    trial
                        .speed_ratio
                        .map_or(self.speed_tolerance, |_| EXACT_SPEED),
                ),
            };
            // What is left of a known line close to its place tells of no other one.
            let near_hz = RESIDUE_CELLS * trial.cell_hz + SAME_LINE * frequency_hz;
            let is_residue = known_mm
                .iter()
                .any(|known| (trial.actual_speed_mm_s() / known - frequency_hz).abs() < near_hz);
            if is_residue || !(LOWEST_HZ..=HIGHEST_HZ).contains(&frequency_hz) {
                return None;
            }
            let within_hz = PLACE_CELLS * trial.cell_hz + tolerance * frequency_hz;
            let peak = trial.peak_near(frequency_hz, within_hz);
            Some((trial.speed_mm_s, peak.map(|(peak, ln)| ((index, peak), ln))))
        });
        let speeds = by_speed(seen);
        let shown = || speeds.iter().filter(|speed| speed.ln_chance() < ln_bound);
        let count = shown().count();
        // Half of the speeds, by which Markov's inequality holds the level; see the head of this module.
        if count < 2 || 2 * count < speeds.len() {
            return None;
        }
        let slowest = shown().map(|s| s.speed_mm_s).fold(f64::INFINITY, f64::min);
        let fastest = shown().map(|s| s.speed_mm_s).fold(0.0, f64::max);
        if fastest / slowest < LEAST_SPEED_RATIO + 4.0 * self.speed_tolerance {
            return None;
        }
        let evidence = || shown().map(|speed| -speed.ln_chance());
        let score = evidence().map(|e| e.min(MOST_EVIDENCE)).sum::<f64>() / speeds.len() as f64;
        // A trial shows a line that others have established by less than it takes to establish one.
        let shown_by = shown().flat_map(|speed| &speed.shown);
        let shown_by = shown_by.filter(|(_, ln)| *ln < LN_SHOWN_CHANCE);
        Some(Support {
            hypothesis,
            score,
            evidence: evidence().sum(),
            shown_by: shown_by.map(|(peak, _)| *peak).collect(),
            speeds: (count, speeds.len()),
        })
    }
}

/// Distance from a known line within which its residue lies, cells, and relative to its frequency.
const RESIDUE_CELLS: f64 = 3.0;
const SAME_LINE: f64 = 3e-3;

/// Relative error of a speed that was measured by lines found before.
const EXACT_SPEED: f64 = 2e-4;

/// Least ratio of the fastest to the slowest speed that show a line: at closer ones, place is not told from time.
pub(super) const LEAST_SPEED_RATIO: f64 = 1.05;

/// Chance below which a trial counts among those that show an established line.
const LN_SHOWN_CHANCE: f64 = -7.0;

/// Difference of the logarithms of two speeds that count as one: repeats that were measured do not agree to the digit.
const SAME_SPEED: f64 = 0.02;

/// The trials at one speed, with what they show, each with the logarithm of its chance.
pub(super) struct AtSpeed<T> {
    /// The speed of the first of them, mm/s.
    pub speed_mm_s: f64,
    trials: usize,
    shown: Vec<(T, f64)>,
}

impl<T> AtSpeed<T> {
    /// Logarithm of the Bonferroni-corrected p-value of the least chance among the trials.
    pub(super) fn ln_chance(&self) -> f64 {
        let least = self.shown.iter().map(|(_, ln)| *ln).fold(0.0, f64::min);
        (least + (self.trials as f64).ln()).min(0.0)
    }
}

/// Trials, each with its speed and what it shows, by their speed.
pub(super) fn by_speed<T>(
    trials: impl Iterator<Item = (f64, Option<(T, f64)>)>,
) -> Vec<AtSpeed<T>> {
    let mut speeds: Vec<AtSpeed<T>> = Vec::new();
    for (speed_mm_s, shown) in trials {
        let is_same = |at: &AtSpeed<T>| (speed_mm_s / at.speed_mm_s).ln().abs() < SAME_SPEED;
        let at = speeds.iter().position(is_same).unwrap_or_else(|| {
            speeds.push(AtSpeed {
                speed_mm_s,
                trials: 0,
                shown: Vec::new(),
            });
            speeds.len() - 1
        });
        speeds[at].trials += 1;
        speeds[at].shown.extend(shown);
    }
    speeds
}
