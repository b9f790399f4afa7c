//! The search for lines that move with speed: narrow peaks at one wavelength over several speeds.
//!
//! A peak at the frequency f of a trial at the speed v has two explanations. It may belong to a wavelength v/f, which
//! predicts peaks at other frequencies at other speeds. Or it may belong to the frequency f itself, as with hum, a
//! motor or a resonance, which predicts peaks at the same frequency at every speed. The hypothesis that explains its
//! trials best is accepted first. The peaks that it explains are removed from the recordings, and the search continues
//! in the remainder. So a line explains its own peaks before they can be attributed to another hypothesis, and a
//! harmonic of the mains that happens to lie at v/λ is removed before λ is tested.
//!
//! # The test's level
//!
//! A speed shows a hypothesis if the probability of the highest peak within its window is below a bound b, corrected
//! for the window's cells and for the number of trials at that speed. A wavelength is accepted if at least two speeds
//! show it, and at least half of the speeds at which it could be seen. In noise, at most a fraction b of the speeds is
//! expected to show it. By Markov's inequality, half of them do so with a probability of at most 2b, *however the
//! trials depend on each other*: they are strokes over one surface, whose irregularities return. With M distinguishable
//! wavelengths, b = level / 2M holds the level of one search. A texture is searched twice, so half of this bound is
//! used.

use std::borrow::Cow;
use std::ops::ControlFlow;

use model_format::SAMPLE_RATE_HZ;
use model_format::limits::MAX_LINES;
use stylus_dsp::sums::upper_median;

use super::peaks::{HIGHEST_HZ, LOWEST_HZ, LineSpectrum, Peak};
use super::track::{amplitudes, at_even_places, followed, refined, steady, subtract, wave};

/// Probability of finding any line in a texture that has none.
pub(super) const LEVEL: f64 = 1e-3;

/// Searches of each texture, with different assumed errors of the listed speeds. They share the level.
const SEARCHES: f64 = 2.0;

/// Error of a peak's frequency due to noise, cells.
const PLACE_CELLS: f64 = 1.0;

/// Natural logarithm of the probability above which a peak suggests no hypothesis.
const LN_HYPOTHESIS_CHANCE: f64 = -14.0;

/// Largest evidence that one speed can contribute to the score, as minus the logarithm of its probability. A hypothesis
/// is judged by how many speeds show it, not by one very strong peak.
const MOST_EVIDENCE: f64 = 60.0;

/// Largest number of lines that a search removes, counting both those tied to position and those of constant frequency.
const MOST_REMOVED: usize = 40;

/// Number of the highest harmonic of a known line that is tested.
pub(super) const HARMONICS: u32 = 8;

/// One trial as the search sees it.
#[derive(Clone)]
pub(super) struct SearchedTrial<'s> {
    /// Speed of the trial as listed, mm/s.
    pub speed_mm_s: f64,
    /// Ratio of the trial's actual speed to the listed one, once a line has given it.
    pub speed_ratio: Option<f64>,
    /// Samples of the trial, without the lines that were removed.
    signal: Cow<'s, [f64]>,
    peaks: Vec<Peak>,
    cell_hz: f64,
    /// Least background. It comes from the spectrum before anything was removed.
    floor: f64,
}

impl<'s> SearchedTrial<'s> {
    /// Analyses `signal`; `None` if it is too short or silent.
    pub(super) fn of(speed_mm_s: f64, signal: &'s [f64]) -> Option<Self> {
        let spectrum = LineSpectrum::of(signal)?;
        Some(Self {
            speed_mm_s,
            speed_ratio: None,
            signal: Cow::Borrowed(signal),
            peaks: spectrum.peaks(),
            cell_hz: spectrum.cell_hz,
            floor: spectrum.floor,
        })
    }

    fn hear_again(&mut self) {
        let spectrum = LineSpectrum::of(&self.signal);
        self.peaks = spectrum.map_or_else(Vec::new, |mut spectrum| {
            spectrum.floor = spectrum.floor.max(self.floor);
            spectrum.peaks()
        });
    }

    /// Returns the peak that stands out most within `within_hz` of `frequency_hz`, and the logarithm of its p-value,
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
        let wave = wave(steady(exact_hz, self.signal.len()).into_iter());
        let amplitude = amplitudes(
            &self.signal,
            std::slice::from_ref(&(0..self.signal.len())),
            std::slice::from_ref(&wave),
        )[0];
        subtract(self.signal.to_mut(), amplitude, &wave);
        self.hear_again();
        exact_hz
    }

    /// Resamples the signal at even positions if the phase of the sine at `frequency_hz` shows that the speed wandered.
    /// The other lines of the surface then become as narrow as this one, and none leaves a residue that looks like a
    /// line.
    fn straighten(&mut self, frequency_hz: f64) {
        let exact_hz = refined(&self.signal, frequency_hz, self.cell_hz);
        // Positions, in wavelengths.
        let mut places = steady(exact_hz, self.signal.len());
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

/// A line tied to position, as the search found it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    /// Wavelength, mm: the median over the trials.
    pub wavelength_mm: f64,
    /// Index of each trial that shows the line, and the line's frequency there, Hz.
    pub shown_by: Vec<(usize, f64)>,
    /// Number of speeds that show the line, and number of speeds at which it could be seen.
    pub speeds: (usize, usize),
}

/// The outcome of a search.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Outcome {
    /// Lines tied to position, those that explain most first.
    pub lines: Vec<Found>,
    /// Frequencies that stay the same while the speed changes, Hz.
    pub time_locked_hz: Vec<f64>,
}

/// How well the trials support a hypothesis.
struct Support {
    hypothesis: Hypothesis,
    /// Mean evidence over the speeds. That of one speed counts up to [`MOST_EVIDENCE`].
    score: f64,
    /// Sum of all evidence.
    evidence: f64,
    shown_by: Vec<(usize, Peak)>,
    speeds: (usize, usize),
}

impl Support {
    /// Returns whether this support is better than `other`. The higher score wins. If the scores are equal, constant
    /// frequency wins over position, and then the higher sum of evidence.
    fn is_better(&self, other: &Self) -> bool {
        let is_of_time = |own: &Self| matches!(own.hypothesis, Hypothesis::Time(_));
        let key = |own: &Self| (own.score, is_of_time(own), own.evidence);
        key(self) > key(other)
    }
}

/// The search over the trials of one texture.
pub(super) struct Search<'s> {
    pub trials: Vec<SearchedTrial<'s>>,
    /// Relative error of a listed speed.
    pub speed_tolerance: f64,
}

impl Search<'_> {
    /// Finds lines until nothing more stands out, or a texture can hold no more.
    pub(super) fn run(mut self) -> Outcome {
        let mut outcome = Outcome::default();
        for _ in 0..MOST_REMOVED {
            if self.step(&mut outcome).is_break() || outcome.lines.len() == MAX_LINES {
                break;
            }
        }
        outcome
    }

    fn step(&mut self, outcome: &mut Outcome) -> ControlFlow<()> {
        let known: Vec<f64> = outcome.lines.iter().map(|line| line.wavelength_mm).collect();
        let Some(support) = self.best(&known) else {
            return ControlFlow::Break(());
        };
        match support.hypothesis {
            Hypothesis::Place(wavelength_mm) => {
                let shown_by = self.remove_line(wavelength_mm, &support);
                let of_trial = |&(trial, hz): &(usize, f64)| self.trials[trial].actual_speed_mm_s() / hz;
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
            // The first line gives the actual speed, which the search for later lines uses.
            let listed_hz = trial.speed_mm_s / wavelength_mm;
            trial.speed_ratio.get_or_insert(exact_hz / listed_hz);
            shown_by.push((*index, exact_hz));
        }
        shown_by
    }

    /// Returns the support of the best acceptable hypothesis.
    fn best(&self, known_mm: &[f64]) -> Option<Support> {
        let longest = self.trials.iter().map(|trial| trial.signal.len()).max()?;
        let longest_s = longest as f64 / f64::from(SAMPLE_RATE_HZ);
        // Distinguishable wavelengths: M = 2 f T, two per cell up to the highest frequency.
        let ln_bound = (LEVEL / SEARCHES / (2.0 * 2.0 * HIGHEST_HZ * longest_s)).ln();
        // Harmonics of known lines are few (there are at most eight lines), and so need less evidence.
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

    /// Returns the hypotheses that single peaks suggest. One line may suggest several.
    fn hypotheses(&self) -> Vec<Hypothesis> {
        let mut all: Vec<Hypothesis> = Vec::new();
        for trial in &self.trials {
            for peak in &trial.peaks {
                if peak.ln_chance < LN_HYPOTHESIS_CHANCE {
                    all.push(Hypothesis::Place(trial.actual_speed_mm_s() / peak.frequency_hz));
                    all.push(Hypothesis::Time(peak.frequency_hz));
                }
            }
        }
        all
    }

    /// Returns the support of the trials for `hypothesis`; `None` if it is not acceptable.
    fn support(&self, hypothesis: Hypothesis, ln_bound: f64, known_mm: &[f64]) -> Option<Support> {
        let seen = self.trials.iter().enumerate().filter_map(|(index, trial)| {
            let (frequency_hz, tolerance) = match hypothesis {
                Hypothesis::Time(frequency_hz) => (frequency_hz, 0.0),
                Hypothesis::Place(wavelength_mm) => (
                    trial.actual_speed_mm_s() / wavelength_mm,
                    trial.speed_ratio.map_or(self.speed_tolerance, |_| EXACT_SPEED),
                ),
            };
            // A peak close to a known line is what was left of that line, and is no evidence of another.
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
        // At least half of the speeds, by which Markov's inequality holds the level; see the module's documentation.
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
        // Once the speeds have established a line, a trial needs less evidence to count as showing it.
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

/// Distance from a known line within which its residue lies: a number of cells, plus a fraction of the frequency.
const RESIDUE_CELLS: f64 = 3.0;
const SAME_LINE: f64 = 3e-3;

/// Relative error of a trial's speed once a line has given it.
const EXACT_SPEED: f64 = 2e-4;

/// Least ratio of the fastest to the slowest speed at which a line shows. If they are closer, a line tied to position
/// cannot be distinguished from one of constant frequency.
pub(super) const LEAST_SPEED_RATIO: f64 = 1.05;

/// Natural logarithm of the probability below which a trial counts as showing an established line.
const LN_SHOWN_CHANCE: f64 = -7.0;

/// Difference of the logarithms of two speeds below which they count as the same speed: the measured speeds of repeated
/// trials differ slightly.
const SAME_SPEED: f64 = 0.02;

/// The trials at one speed, and what they show, each with the logarithm of its probability.
pub(super) struct AtSpeed<T> {
    /// Speed of the first of these trials, mm/s.
    pub speed_mm_s: f64,
    trials: usize,
    shown: Vec<(T, f64)>,
}

impl<T> AtSpeed<T> {
    /// Returns the logarithm of the smallest p-value of these trials, corrected for their number (Bonferroni).
    pub(super) fn ln_chance(&self) -> f64 {
        let least = self.shown.iter().map(|(_, ln)| *ln).fold(0.0, f64::min);
        (least + (self.trials as f64).ln()).min(0.0)
    }
}

/// Groups trials by speed. Each has its speed and, if it shows something, that with the logarithm of its probability.
pub(super) fn by_speed<T>(trials: impl Iterator<Item = (f64, Option<(T, f64)>)>) -> Vec<AtSpeed<T>> {
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
