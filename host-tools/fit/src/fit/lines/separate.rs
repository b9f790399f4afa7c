//! Separation of a texture's trials into lines and the remainder.

use std::borrow::Cow;
use std::f64::consts::TAU;
use std::ops::Range;

use model_format::{SAMPLE_RATE_HZ, Wander, limits};
use rayon::prelude::*;
use stylus_dsp::fourier::Complex;
use stylus_dsp::sums::{range_of, upper_median};

use super::findings::{Findings, Line, NoLines, TrialLines};
use super::peaks::{HIGHEST_HZ, LineSpectrum, tells_lines};
use super::search::{Found, LEAST_SPEED_RATIO, Search, SearchedTrial};
use super::track::{amplitudes, followed, steady, subtract, wave_at};
use super::wander::{Course, Weave, find};

/// Relative error of the speeds in a rig's list.
const EXACT_LIST: f64 = 1e-3;

/// Relative error of the speeds in a list that was not made by a rig.
const ROUGH_LIST: f64 = 2e-2;

/// Least distance of two lines in a spectrum at which least squares can determine both amplitudes, cells.
const TOLD_APART_CELLS: f64 = 1.5;

/// Ratio of the power of the wandering lines to that of the narrow lines above which the wandering ones are used.
pub(super) const WANDERING_OVER_NARROW: f64 = 1.1;

/// Largest number of corrections of a trial's course of positions.
const FOLLOWED_TIMES: usize = 3;

/// Largest relative deviation of a ratio of wavelengths from a whole number for a line to count as a harmonic.
const HARMONIC_TOLERANCE: f64 = 2e-3;

/// A narrow line that was found, and, for a harmonic, the index of its fundamental and its number.
pub(super) struct Known {
    pub found: Found,
    pub harmonic_of: Option<(usize, u32)>,
}

/// The trials of a texture, separated into its lines and the remainder.
#[derive(Debug)]
pub(crate) struct Separated {
    /// The lines.
    pub findings: Findings,
    /// What each trial has of the lines.
    pub shares: Vec<TrialLines>,
    /// The signals without the lines, m/s².
    pub rest: Vec<Vec<f64>>,
    /// Whether the lines' phase was followed through changes of speed, for each trial; empty if in none.
    pub followed: Vec<bool>,
}

impl Separated {
    /// Returns the result for `signals` without lines.
    fn nothing(signals: Vec<Vec<f64>>, time_locked_hz: Vec<f64>, reason: NoLines) -> Self {
        Self {
            findings: Findings {
                time_locked_hz,
                none_because: Some(reason),
                ..Findings::default()
            },
            shares: vec![TrialLines::default(); signals.len()],
            rest: signals,
            followed: Vec::new(),
        }
    }

    /// Power of all lines in all trials: the sum of their squared amplitudes, (m/s²)².
    fn power(&self) -> f64 {
        let amplitudes = self.shares.iter().flat_map(|share| &share.amplitudes_m_s2);
        amplitudes.flatten().map(|amplitude| amplitude * amplitude).sum()
    }
}

/// Finds the lines of one texture and subtracts them from its trials.
///
/// `signals` are m/s² at 5 kHz without gaps, and `speeds_mm_s` their listed speeds. Amplitudes and phases are estimated
/// from the samples in the `ranges` of each.
pub(crate) fn separate(speeds_mm_s: &[f64], signals: Vec<Vec<f64>>, ranges: &[Vec<Range<usize>>]) -> Separated {
    let used = speeds_mm_s
        .iter()
        .zip(&signals)
        .filter(|(v, s)| **v > 0.0 && tells_lines(s));
    let (slowest, fastest) = range_of(used.map(|(v, _)| *v));
    if fastest <= 0.0 {
        return Separated::nothing(signals, Vec::new(), NoLines::NothingSearched);
    }
    if fastest < LEAST_SPEED_RATIO * slowest {
        return wandering(speeds_mm_s, &signals, ranges, true, Vec::new())
            .unwrap_or_else(|_| Separated::nothing(signals, Vec::new(), NoLines::OneSpeed));
    }
    let (known, time_locked_hz) = narrow(speeds_mm_s, &signals);
    let wandering = wandering(speeds_mm_s, &signals, ranges, false, time_locked_hz.clone());
    if known.is_empty() {
        return wandering
            .unwrap_or_else(|time_locked_hz| Separated::nothing(signals, time_locked_hz, NoLines::NothingStandsOut));
    }
    let narrow = removed(speeds_mm_s, signals, ranges, &known, time_locked_hz);
    // A narrow line holds only a part of a line that wanders.
    let least = WANDERING_OVER_NARROW * narrow.power();
    wandering.ok().filter(|own| own.power() > least).unwrap_or(narrow)
}

/// Returns the narrow lines, and the frequencies that stay the same while the speed changes.
pub(super) fn narrow(speeds_mm_s: &[f64], signals: &[Vec<f64>]) -> (Vec<Known>, Vec<f64>) {
    let heard = heard(speeds_mm_s, signals);
    let again = heard.clone();
    let (exact, rough) = rayon::join(|| search(heard, EXACT_LIST), || search(again, ROUGH_LIST));
    // The search with wider windows for a line's frequency is used if more speeds show a line there.
    let speeds = |known: &[Known]| known.iter().map(|line| line.found.speeds.0).max();
    if speeds(&rough.0) > speeds(&exact.0) {
        rough
    } else {
        exact
    }
}

/// Finds lines that wander and subtracts them from `signals`. If there are none, returns the frequencies that stay the
/// same while the speed changes.
fn wandering(
    speeds_mm_s: &[f64],
    signals: &[Vec<f64>],
    ranges: &[Vec<Range<usize>>],
    is_one_speed: bool,
    mut time_locked_hz: Vec<f64>,
) -> Result<Separated, Vec<f64>> {
    let (mut lines, mut wanders) = (Vec::<Line>::new(), Vec::<Wander>::new());
    let mut amplitudes: Vec<Vec<Option<f64>>> = vec![Vec::new(); signals.len()];
    let mut rest = Cow::Borrowed(signals);
    while wanders.len() < limits::MAX_WANDERS && lines.len() < limits::MAX_LINES {
        let known_mm: Vec<f64> = lines.iter().map(|line| line.wavelength_mm).collect();
        let mut weave = match find(speeds_mm_s, &rest, ranges, is_one_speed, &known_mm) {
            Ok(weave) => weave,
            Err(held_hz) => {
                time_locked_hz.extend(held_hz);
                break;
            }
        };
        weave.harmonics.truncate(limits::MAX_LINES - lines.len());
        let trials = rest.to_mut().par_iter_mut().zip(&weave.courses);
        trials.zip(&mut amplitudes).for_each(|((signal, course), amplitudes)| {
            amplitudes.extend(without(signal, course.as_ref(), &weave));
        });
        add_lines_of(&weave, wanders.len(), &amplitudes, &mut lines);
        wanders.push(weave.wander);
    }
    if lines.is_empty() {
        return Err(time_locked_hz);
    }
    let share = |amplitudes_m_s2| TrialLines {
        amplitudes_m_s2,
        speed_ratio: None,
    };
    Ok(Separated {
        findings: Findings {
            lines,
            time_locked_hz,
            wanders,
            ..Findings::default()
        },
        shares: amplitudes.into_iter().map(share).collect(),
        rest: rest.into_owned(),
        followed: Vec::new(),
    })
}

/// Adds the harmonics of `weave` to `lines`. `wander` is the index of its wander, and `amplitudes` holds the amplitudes
/// of all lines in each trial.
fn add_lines_of(weave: &Weave, wander: usize, amplitudes: &[Vec<Option<f64>>], lines: &mut Vec<Line>) {
    let first = lines.len();
    for &(number, shown_at_speeds) in &weave.harmonics {
        let is_harmonic = number > 1 && weave.harmonics[0].0 == 1;
        let (phase_turns, phase_agreement) = if is_harmonic {
            let complex = |course: &Course, harmonic| course.amplitude(harmonic).map(|a| a.0);
            let pairs = weave.courses.iter().flatten();
            let pairs = pairs.filter_map(|c| Some((complex(c, 1)?, complex(c, number)?)));
            relative_phase(pairs, number)
        } else {
            (0.0, 1.0)
        };
        let at = lines.len();
        let own = amplitudes.iter().filter_map(|amplitudes| amplitudes[at]);
        lines.push(Line {
            wavelength_mm: weave.wavelength_mm / f64::from(number),
            phase_turns,
            harmonic_of: is_harmonic.then_some((first, number)),
            phase_agreement,
            shown_at_speeds,
            amplitude_range_m_s2: range_of(own.filter(|&amplitude| amplitude > 0.0)),
            wander: Some(wander),
        });
    }
}

/// Subtracts the harmonics of `weave` from `signal`, along the signal's `course`. Returns the amplitude of each
/// harmonic. It is 0, and the harmonic stays in the signal, if there is no course, if the trial cannot hold the
/// harmonic, or if it cannot be distinguished from noise.
fn without(signal: &mut [f64], course: Option<&Course>, weave: &Weave) -> Vec<Option<f64>> {
    let numbers = weave.harmonics.iter().map(|(number, _)| *number);
    let Some(course) = course else {
        return numbers.map(|_| Some(0.0)).collect();
    };
    let fundamental = wave_at(&course.place_mm, weave.wavelength_mm);
    let (mut wave, mut power) = (fundamental.clone(), 1);
    let amplitudes = numbers.map(|number| {
        let Some((amplitude, clean, stays)) = course.amplitude(number) else {
            return Some(0.0);
        };
        // Harmonics are powers of the fundamental's wave, which saves computing sines.
        for _ in power..number {
            wave.iter_mut().zip(&fundamental).for_each(|(w, z)| *w *= z);
        }
        power = number;
        let held: Vec<_> = wave.iter().zip(&course.held).map(|(w, held)| w * held).collect();
        subtract(signal, amplitude * (1.0 - stays), &held);
        Some(clean)
    });
    amplitudes.collect()
}

/// Returns the trials that are searched for lines, with their indices.
fn heard<'s>(speeds_mm_s: &[f64], signals: &'s [Vec<f64>]) -> Vec<(usize, SearchedTrial<'s>)> {
    let pairs: Vec<_> = speeds_mm_s.iter().zip(signals).enumerate().collect();
    pairs
        .into_par_iter()
        .filter(|(_, (speed, _))| **speed > 0.0)
        .filter_map(|(index, (speed, signal))| Some((index, SearchedTrial::of(*speed, signal)?)))
        .collect()
}

/// Returns the lines found in the trials, and the frequencies that stay the same.
fn search(heard: Vec<(usize, SearchedTrial<'_>)>, speed_tolerance: f64) -> (Vec<Known>, Vec<f64>) {
    let (indices, trials): (Vec<usize>, Vec<SearchedTrial>) = heard.into_iter().unzip();
    let search = Search {
        trials,
        speed_tolerance,
    };
    let outcome = search.run();
    let lines = outcome.lines.into_iter().map(|mut found| {
        found
            .shown_by
            .iter_mut()
            .for_each(|(trial, _)| *trial = indices[*trial]);
        found
    });
    (with_harmonics(lines.collect()), outcome.time_locked_hz)
}

/// Orders lines by falling wavelength and identifies the harmonics. [`measures`] makes their wavelengths exact
/// fractions.
fn with_harmonics(mut lines: Vec<Found>) -> Vec<Known> {
    lines.sort_by(|a, b| b.wavelength_mm.total_cmp(&a.wavelength_mm));
    let mut known: Vec<Known> = Vec::new();
    for found in lines {
        let harmonic_of = known.iter().enumerate().find_map(|(index, other)| {
            let ratio = other.found.wavelength_mm / found.wavelength_mm;
            let number = ratio.round();
            let is_harmonic = number > 1.5 && (ratio / number - 1.0).abs() < HARMONIC_TOLERANCE;
            (other.harmonic_of.is_none() && is_harmonic).then_some((index, number as u32))
        });
        known.push(Known { found, harmonic_of });
    }
    known
}

/// Wavelengths and speeds, as measured by the lines in the trials.
pub(super) struct Measures {
    pub wavelengths_mm: Vec<f64>,
    pub speed_ratios: Vec<Option<f64>>,
    speed_scatter: Option<f64>,
}

pub(super) fn measures(speeds_mm_s: &[f64], signals: &[Vec<f64>], known: &[Known]) -> Measures {
    // Each line is evidence of its fundamental's wavelength.
    let fundamental = |index: usize| known[index].harmonic_of.map_or((index, 1), |(of, n)| (of, n));
    let mut wavelengths_mm: Vec<f64> = known.iter().map(|line| line.found.wavelength_mm).collect();
    let mut scatter: Option<f64> = None;
    for base in 0..known.len() {
        if known[base].harmonic_of.is_some() {
            continue;
        }
        // One value per trial: from its line with the most cycles, for which a cell is the smallest relative error.
        let mut of_trial: Vec<Option<(f64, f64)>> = vec![None; signals.len()];
        for (index, line) in known.iter().enumerate() {
            let (of, number) = fundamental(index);
            if of != base {
                continue;
            }
            for &(trial, hz) in &line.found.shown_by {
                let cycles = hz * signals[trial].len() as f64;
                if of_trial[trial].is_none_or(|(_, most)| cycles > most) {
                    of_trial[trial] = Some((speeds_mm_s[trial] * f64::from(number) / hz, cycles));
                }
            }
        }
        let values: Vec<(f64, f64)> = of_trial.into_iter().flatten().collect();
        if let Some((mean, spread)) = weighted_mean(&values) {
            wavelengths_mm[base] = mean;
            if values.len() > 2 {
                scatter = Some(scatter.unwrap_or(0.0).max(spread));
            }
        }
    }
    for (index, line) in known.iter().enumerate() {
        if let Some((of, number)) = line.harmonic_of {
            wavelengths_mm[index] = wavelengths_mm[of] / f64::from(number);
        }
    }
    let mut sums = vec![(0.0, 0.0); signals.len()];
    for (line, wavelength_mm) in known.iter().zip(&wavelengths_mm) {
        for &(trial, hz) in &line.found.shown_by {
            // The error of a frequency is a fixed fraction of a cell, so its relative variance falls with the
            // frequency's square.
            let weight = hz * hz;
            sums[trial].0 += weight * hz * wavelength_mm / speeds_mm_s[trial];
            sums[trial].1 += weight;
        }
    }
    let ratio = |(sum, weight): (f64, f64)| (weight > 0.0).then(|| sum / weight);
    Measures {
        wavelengths_mm,
        speed_ratios: sums.into_iter().map(ratio).collect(),
        speed_scatter: scatter,
    }
}

/// Returns the weighted mean of (value, cycles times the sample rate) pairs, and the values' relative scatter.
///
/// A longer recording does not reduce the errors of the speeds. The scatter therefore bounds the weights.
fn weighted_mean(values: &[(f64, f64)]) -> Option<(f64, f64)> {
    let (of_trials, _): (Vec<f64>, Vec<f64>) = values.iter().copied().unzip();
    let middle = upper_median(&of_trials)?;
    let deviations = of_trials.iter().map(|value| (value / middle - 1.0).abs());
    // The median absolute deviation of a Gaussian variable is 0.6745 times its standard deviation (Hampel, JASA 69,
    // 1974, 383).
    let spread = 1.48 * upper_median(&deviations.collect::<Vec<_>>())?;
    let most = values.iter().map(|(_, cycles)| *cycles).fold(0.0, f64::max);
    // The relative variance has two terms: that of the frequency, known to a fraction of a cycle over the recording,
    // and that of the speed. Both are in units of the longest recording, which cancel. The fraction is the reciprocal
    // of the sample rate, because the cycles are counted times that. It is too small, which costs nothing: with 0.03,
    // simulated wavelengths are closer only if the speeds are exact to 1e-4, and with 1 they are a fifth further off.
    let weight = |cycles: f64| 1.0 / ((most / cycles).powi(2) + (spread * most).powi(2));
    let total: f64 = values.iter().map(|(_, cycles)| weight(*cycles)).sum();
    let sum: f64 = values.iter().map(|(value, cycles)| weight(*cycles) * value).sum();
    Some((sum / total, spread))
}

/// The lines fitted to one trial.
struct Fitted {
    amplitudes: Vec<Option<Complex<f64>>>,
    /// Amplitudes without the contribution of noise.
    clean: Vec<Option<f64>>,
    was_followed: bool,
}

/// Subtracts the `known` lines from `signals`.
fn removed(
    speeds_mm_s: &[f64],
    mut signals: Vec<Vec<f64>>,
    ranges: &[Vec<Range<usize>>],
    known: &[Known],
    time_locked_hz: Vec<f64>,
) -> Separated {
    let measures = measures(speeds_mm_s, &signals, known);
    let fits: Vec<Fitted> = signals
        .par_iter_mut()
        .zip(speeds_mm_s)
        .zip(&measures.speed_ratios)
        .enumerate()
        .map(|(index, ((signal, speed), ratio))| {
            let speed_mm_s = speed * ratio.unwrap_or(1.0);
            removed_from(signal, &ranges[index], speed_mm_s, &measures.wavelengths_mm)
        })
        .collect();
    let lines = known.iter().enumerate().map(|(index, line)| {
        let (phase_turns, phase_agreement) = match line.harmonic_of {
            Some((of, number)) => {
                let pairs = fits
                    .iter()
                    .filter_map(|fit| Some((fit.amplitudes[of]?, fit.amplitudes[index]?)));
                relative_phase(pairs, number)
            }
            None => (0.0, 1.0),
        };
        let shown = line.found.shown_by.iter();
        Line {
            wavelength_mm: measures.wavelengths_mm[index],
            phase_turns,
            harmonic_of: line.harmonic_of,
            phase_agreement,
            shown_at_speeds: line.found.speeds,
            amplitude_range_m_s2: range_of(shown.filter_map(|&(trial, _)| fits[trial].clean[index])),
            wander: None,
        }
    });
    let findings = Findings {
        lines: lines.collect(),
        time_locked_hz,
        speed_scatter: measures.speed_scatter,
        followed_trials: fits.iter().filter(|fit| fit.was_followed).count(),
        none_because: None,
        wanders: Vec::new(),
    };
    let followed = fits.iter().map(|fit| fit.was_followed).collect();
    let shares = fits.into_iter().zip(measures.speed_ratios);
    let share = |(fit, speed_ratio): (Fitted, Option<f64>)| TrialLines {
        amplitudes_m_s2: fit.clean,
        speed_ratio,
    };
    Separated {
        findings,
        shares: shares.map(share).collect(),
        rest: signals,
        followed,
    }
}

/// Returns the phase of harmonic `number` at the position where its fundamental's sine begins, turns, and how well the
/// trials agree on it. `pairs` holds the amplitudes of fundamental and harmonic in each trial.
pub(super) fn relative_phase(pairs: impl Iterator<Item = (Complex<f64>, Complex<f64>)>, number: u32) -> (f64, f64) {
    // As sines: a cosine is a quarter of a turn ahead.
    let sine = |c: Complex<f64>| c * Complex::i();
    let mut sum = Complex::<f64>::default();
    let mut weight = 0.0;
    for (base, harmonic) in pairs {
        let (base, harmonic) = (sine(base), sine(harmonic));
        let turned = harmonic * Complex::from_polar(base.norm(), -f64::from(number) * base.arg());
        sum += turned;
        weight += turned.norm();
    }
    if weight <= 0.0 {
        return (0.0, 0.0);
    }
    ((sum.arg() / TAU).rem_euclid(1.0), sum.norm() / weight)
}

/// Subtracts lines of these wavelengths from `signal`, recorded at `speed_mm_s`. They are fitted to the samples in
/// `ranges`.
fn removed_from(signal: &mut [f64], ranges: &[Range<usize>], speed_mm_s: f64, wavelengths_mm: &[f64]) -> Fitted {
    let mut fitted = Fitted {
        amplitudes: vec![None; wavelengths_mm.len()],
        clean: vec![None; wavelengths_mm.len()],
        was_followed: false,
    };
    let held = told_apart(speed_mm_s, signal.len(), wavelengths_mm);
    if held.is_empty() || ranges.is_empty() || !tells_lines(signal) {
        return fitted;
    }
    let held_mm: Vec<f64> = held.iter().map(|&line| wavelengths_mm[line]).collect();
    let Followed {
        waves,
        amplitudes: fit,
        is_corrected,
        ..
    } = Followed::of(signal, ranges, steady(speed_mm_s, signal.len()), &held_mm);
    fitted.was_followed = is_corrected;
    let mut rest = signal.to_vec();
    for (amplitude, wave) in fit.iter().zip(&waves) {
        subtract(&mut rest, *amplitude, wave);
    }
    let Some(spectrum) = LineSpectrum::of(&rest) else {
        // The signal holds nothing but lines.
        for (&line, amplitude) in held.iter().zip(&fit) {
            fitted.amplitudes[line] = Some(*amplitude);
            fitted.clean[line] = Some(amplitude.norm());
        }
        signal.copy_from_slice(&rest);
        return fitted;
    };
    let samples: usize = ranges.iter().map(ExactSizeIterator::len).sum();
    for ((&line, amplitude), wave) in held.iter().zip(&fit).zip(&waves) {
        let noise = spectrum.noise_amplitude_squared(speed_mm_s / wavelengths_mm[line], samples);
        let clean = (amplitude.norm_sqr() - noise).max(0.0).sqrt();
        // As much stays as noise would have there, so that the remainder has no hole.
        let stays = (noise.sqrt() / amplitude.norm().max(f64::MIN_POSITIVE)).min(1.0);
        subtract(signal, *amplitude * (1.0 - stays), wave);
        fitted.amplitudes[line] = Some(*amplitude);
        fitted.clean[line] = Some(clean);
    }
    fitted
}

/// The lines fitted to a signal.
pub(super) struct Followed {
    waves: Vec<Vec<Complex<f64>>>,
    amplitudes: Vec<Complex<f64>>,
    /// Position at each sample, mm.
    pub place_mm: Vec<f64>,
    /// True if the lines showed that the speed changed. The waves then follow it.
    is_corrected: bool,
}

impl Followed {
    /// Fits lines of `wavelengths_mm` to the samples of `signal` in `ranges`. The signal was recorded at `place_mm`.
    /// The waves follow changes of the speed if the lines show them.
    pub(super) fn of(signal: &[f64], ranges: &[Range<usize>], mut place_mm: Vec<f64>, wavelengths_mm: &[f64]) -> Self {
        let mut times = 0;
        loop {
            let waves = wavelengths_mm.iter().map(|mm| wave_at(&place_mm, *mm));
            let waves: Vec<Vec<Complex<f64>>> = waves.collect();
            let amplitudes = amplitudes(signal, ranges, &waves);
            // The line whose phase determines the position best: the strongest in relation to its wavelength.
            let tells = amplitudes.iter().zip(wavelengths_mm);
            let tells = tells.map(|(amplitude, mm)| (amplitude.norm() / mm, mm));
            let best = tells.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, mm)| *mm);
            // The first correction is made with blurred harmonics; later ones start from it and are closer.
            let best = best.filter(|_| times < FOLLOWED_TIMES);
            if !best.is_some_and(|mm| followed(signal, &mut place_mm, mm)) {
                return Self {
                    waves,
                    amplitudes,
                    place_mm,
                    is_corrected: times > 0,
                };
            }
            times += 1;
        }
    }
}

/// Returns the indices of the lines that a recording of `samples` samples at `speed_mm_s` can hold and distinguish from
/// those earlier in the list, which are longer.
pub(super) fn told_apart(speed_mm_s: f64, samples: usize, wavelengths_mm: &[f64]) -> Vec<usize> {
    let least_hz = TOLD_APART_CELLS * f64::from(SAMPLE_RATE_HZ) / samples.max(1) as f64;
    let mut held: Vec<usize> = Vec::new();
    for (line, wavelength_mm) in wavelengths_mm.iter().enumerate() {
        let frequency_hz = speed_mm_s / wavelength_mm;
        let is_alone = held
            .iter()
            .all(|&other| (speed_mm_s / wavelengths_mm[other] - frequency_hz).abs() > least_hz);
        if speed_mm_s > 0.0 && frequency_hz < HIGHEST_HZ && is_alone {
            held.push(line);
        }
    }
    held
}
