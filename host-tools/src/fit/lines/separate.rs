//! Separation of a texture's trials into lines and the rest.

use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use model_format::{SAMPLE_RATE_HZ, Wander, limits};
use rayon::prelude::*;
use realfft::num_complex::Complex;

use super::Lines;
use super::findings::{Findings, Line, NoLines, TrialLines};
use super::peaks::LineSpectrum;
use super::search::{Found, HIGHEST_HZ, Heard, LEAST_SPEED_RATIO, Search};
use super::track::{amplitudes, followed, steady_mm, subtract, turns};
use super::wander::{Course, Weave, find};

/// Relative error of the speeds in a rig's list.
const EXACT_LIST: f64 = 1e-3;

/// Relative error of the speeds in a list that was not made by a rig.
const ROUGH_LIST: f64 = 2e-2;

/// Distance of two lines in a spectrum from which least squares tell their amplitudes, cells.
const TOLD_APART_CELLS: f64 = 1.5;

/// Power that lines whose place wanders must have over that of narrow ones, to be taken in their place.
const WANDERING_OVER_NARROW: f64 = 1.1;

/// Times that the course of a trial's place is corrected at most.
const FOLLOWED_TIMES: usize = 3;

/// Relative difference of a ratio of wavelengths from a whole number for a harmonic.
const HARMONIC_TOLERANCE: f64 = 2e-3;

/// A line that was found, with its frequencies: trial and Hz.
struct Known {
    found: Found,
    harmonic_of: Option<(usize, u32)>,
}

/// Finds the lines of one texture and removes them from its trials.
///
/// `signals` are m/s² at the models' rate, `speeds_mm_s` their listed speeds. What has no listed speed, or gaps, is to
/// be left out by an empty signal. If `fitted` names ranges of each trial's samples, amplitudes and phases are those of
/// these samples alone, as for a fit to a part of each recording. Returns each trial's share; `signals` are then
/// without lines.
pub fn separate(
    speeds_mm_s: &[f64],
    signals: &mut [Vec<f64>],
    fitted: Option<&[Vec<Range<usize>>]>,
    lines: Lines,
) -> Vec<TrialLines> {
    let count = signals.len();
    let nothing = |time_locked_hz, reason| {
        let findings = Arc::new(Findings {
            time_locked_hz,
            none_because: Some(reason),
            ..Findings::default()
        });
        let share = TrialLines {
            findings,
            ..TrialLines::default()
        };
        vec![share; count]
    };
    if lines == Lines::None {
        return nothing(Vec::new(), NoLines::NotAskedFor);
    }
    let used = speeds_mm_s
        .iter()
        .zip(signals.iter())
        .filter(|(v, s)| **v > 0.0 && !s.is_empty());
    let (slowest, fastest) = used.fold((f64::INFINITY, 0.0f64), |(low, high), (v, _)| {
        (low.min(*v), high.max(*v))
    });
    let whole: Vec<Vec<Range<usize>>> = signals
        .iter()
        .map(|signal| std::iter::once(0..signal.len()).collect())
        .collect();
    let ranges = fitted.unwrap_or(&whole);
    if fastest < LEAST_SPEED_RATIO * slowest {
        return wandering(speeds_mm_s, signals, ranges, true, Vec::new())
            .unwrap_or_else(|_| nothing(Vec::new(), NoLines::OneSpeed));
    }
    // Wider windows for a line's place are taken if more speeds show it there.
    let speeds = |known: &[Known]| known.iter().map(|line| line.found.speeds.0).max();
    let heard = heard(speeds_mm_s, signals);
    let (exact, rough) = rayon::join(
        || search(heard.clone(), EXACT_LIST),
        || search(heard.clone(), ROUGH_LIST),
    );
    let (known, time_locked_hz) = if speeds(&rough.0) > speeds(&exact.0) {
        rough
    } else {
        exact
    };
    let mut rest = signals.to_vec();
    let held_hz = time_locked_hz.clone();
    let wandering = wandering(speeds_mm_s, &mut rest, ranges, false, held_hz);
    let (narrow, least) = if known.is_empty() {
        (None, 0.0)
    } else {
        let mut rest = signals.to_vec();
        let shares = removed(speeds_mm_s, &mut rest, ranges, &known, time_locked_hz);
        // A narrow line holds but a part of one that wanders.
        let least = WANDERING_OVER_NARROW * power(&shares);
        (Some((shares, rest)), least)
    };
    let wandering = wandering.map(|shares| (shares, rest));
    let chosen = match (wandering, narrow) {
        (Ok(wandering), _) if power(&wandering.0) > least => wandering,
        (_, Some(narrow)) => narrow,
        (Ok(wandering), None) => wandering,
        (Err(time_locked_hz), None) => return nothing(time_locked_hz, NoLines::NothingStandsOut),
    };
    signals.clone_from_slice(&chosen.1);
    chosen.0
}

/// Power of all lines in all trials, as of amplitudes, (m/s²)².
fn power(shares: &[TrialLines]) -> f64 {
    let amplitudes = shares.iter().flat_map(|share| &share.amplitudes_m_s2);
    amplitudes
        .flatten()
        .map(|amplitude| amplitude * amplitude)
        .sum()
}

/// Finds lines whose place wanders and removes them from `signals`. Returns each trial's share, or, if there are none,
/// the frequencies that stay while the speed changes.
fn wandering(
    speeds_mm_s: &[f64],
    signals: &mut [Vec<f64>],
    ranges: &[Vec<Range<usize>>],
    is_one_speed: bool,
    mut time_locked_hz: Vec<f64>,
) -> Result<Vec<TrialLines>, Vec<f64>> {
    let (mut lines, mut wanders) = (Vec::<Line>::new(), Vec::<Wander>::new());
    let mut amplitudes: Vec<Vec<Option<f64>>> = vec![Vec::new(); signals.len()];
    while wanders.len() < limits::MAX_WANDERS && lines.len() < limits::MAX_LINES {
        let known_mm: Vec<f64> = lines.iter().map(|line| line.wavelength_mm).collect();
        let mut weave = match find(speeds_mm_s, signals, ranges, is_one_speed, &known_mm) {
            Ok(weave) => weave,
            Err(held_hz) => {
                time_locked_hz.extend(held_hz);
                break;
            }
        };
        weave.harmonics.truncate(limits::MAX_LINES - lines.len());
        for (signal, (course, amplitudes)) in signals
            .iter_mut()
            .zip(weave.courses.iter().zip(&mut amplitudes))
        {
            amplitudes.extend(without(signal, course.as_ref(), &weave));
        }
        let first = lines.len();
        for (at, &(number, shown_at_speeds)) in weave.harmonics.iter().enumerate() {
            let is_harmonic = number > 1 && weave.harmonics[0].0 == 1;
            let complex = |course: &Course, harmonic| course.amplitude(harmonic).map(|a| a.0);
            let pairs = weave.courses.iter().flatten();
            let pairs = pairs.filter_map(|c| Some((complex(c, 1)?, complex(c, number)?)));
            let (phase_turns, phase_agreement) = if is_harmonic {
                relative_phase(pairs, number)
            } else {
                (0.0, 1.0)
            };
            let own = amplitudes
                .iter()
                .filter_map(|amplitudes| amplitudes[first + at]);
            let own = own.filter(|&amplitude| amplitude > 0.0);
            let range = own.fold((f64::INFINITY, 0.0f64), |(low, high), a| {
                (low.min(a), high.max(a))
            });
            lines.push(Line {
                wavelength_mm: weave.wavelength_mm / f64::from(number),
                phase_turns,
                harmonic_of: is_harmonic.then_some((first, number)),
                phase_agreement,
                shown_at_speeds,
                amplitude_range_m_s2: (range.0.min(range.1), range.1),
                wander: Some(wanders.len()),
            });
        }
        wanders.push(weave.wander);
    }
    if lines.is_empty() {
        return Err(time_locked_hz);
    }
    let findings = Arc::new(Findings {
        lines,
        time_locked_hz,
        wanders,
        ..Findings::default()
    });
    let share = |amplitudes_m_s2| TrialLines {
        findings: Arc::clone(&findings),
        amplitudes_m_s2,
        speed_ratio: None,
    };
    Ok(amplitudes.into_iter().map(share).collect())
}

/// Takes the harmonics of `weave` out of `signal`, whose `course` it is. Returns the amplitude of each: 0 where the
/// line is not told from noise, in which it stays.
fn without(signal: &mut [f64], course: Option<&Course>, weave: &Weave) -> Vec<Option<f64>> {
    let numbers = weave.harmonics.iter().map(|(number, _)| *number);
    let amplitudes = numbers.map(|number| {
        let told = course.and_then(|course| Some((course, course.amplitude(number)?)));
        let Some((course, (amplitude, clean, stays))) = told else {
            return Some(0.0);
        };
        let turns = turns(&course.place_mm, weave.wavelength_mm / f64::from(number));
        subtract(signal, amplitude * (1.0 - stays), &turns);
        Some(clean)
    });
    amplitudes.collect()
}

/// The trials that lines are sought in, with their indices.
fn heard<'s>(speeds_mm_s: &[f64], signals: &'s [Vec<f64>]) -> Vec<(usize, Heard<'s>)> {
    let pairs: Vec<_> = speeds_mm_s.iter().zip(signals).enumerate().collect();
    pairs
        .into_par_iter()
        .filter(|(_, (speed, _))| **speed > 0.0)
        .filter_map(|(index, (speed, signal))| Some((index, Heard::of(*speed, signal)?)))
        .collect()
}

/// Lines found in the trials, and the frequencies that stay.
fn search(heard: Vec<(usize, Heard<'_>)>, speed_tolerance: f64) -> (Vec<Known>, Vec<f64>) {
    let (indices, trials): (Vec<usize>, Vec<Heard>) = heard.into_iter().unzip();
    let search = Search {
        trials,
        speed_tolerance,
        most_lines: limits::MAX_LINES,
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

/// Orders lines by falling wavelength and names the harmonics, whose wavelengths become exact fractions.
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

/// Wavelengths and speeds, as the trials tell them.
struct Measures {
    wavelengths_mm: Vec<f64>,
    speed_ratios: Vec<Option<f64>>,
    speed_scatter: Option<f64>,
}

fn measures(speeds_mm_s: &[f64], signals: &[Vec<f64>], known: &[Known]) -> Measures {
    // Each line speaks for its fundamental.
    let fundamental = |index: usize| {
        known[index]
            .harmonic_of
            .map_or((index, 1), |(of, n)| (of, n))
    };
    let mut wavelengths_mm: Vec<f64> = known.iter().map(|line| line.found.wavelength_mm).collect();
    let mut scatter: Option<f64> = None;
    for base in 0..known.len() {
        if known[base].harmonic_of.is_some() {
            continue;
        }
        // One value per trial, by its highest harmonic, whose cells are the smallest part of it.
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

/// Mean of values known in proportion to their weight, and their relative scatter.
///
/// The speeds have errors of their own, which no length of a recording lessens: the weights are bounded by the scatter.
fn weighted_mean(values: &[(f64, f64)]) -> Option<(f64, f64)> {
    let mut sorted: Vec<f64> = values.iter().map(|(value, _)| *value).collect();
    sorted.sort_by(f64::total_cmp);
    let middle = *sorted.get(sorted.len() / 2)?;
    let mut deviations: Vec<f64> = sorted
        .iter()
        .map(|value| (value / middle - 1.0).abs())
        .collect();
    deviations.sort_by(f64::total_cmp);
    let spread = 1.48 * deviations[deviations.len() / 2];
    let most = values.iter().map(|(_, cycles)| *cycles).fold(0.0, f64::max);
    let weight = |cycles: f64| 1.0 / ((most / cycles).powi(2) + (spread * most).powi(2));
    let total: f64 = values.iter().map(|(_, cycles)| weight(*cycles)).sum();
    let sum: f64 = values
        .iter()
        .map(|(value, cycles)| weight(*cycles) * value)
        .sum();
    Some((sum / total, spread))
}

/// A trial's fit.
struct Fitted {
    amplitudes: Vec<Option<Complex<f64>>>,
    /// Amplitudes without what noise adds.
    clean: Vec<Option<f64>>,
    was_followed: bool,
}

fn removed(
    speeds_mm_s: &[f64],
    signals: &mut [Vec<f64>],
    ranges: &[Vec<Range<usize>>],
    known: &[Known],
    time_locked_hz: Vec<f64>,
) -> Vec<TrialLines> {
    let measures = measures(speeds_mm_s, signals, known);
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
        let shown = line
            .found
            .shown_by
            .iter()
            .filter_map(|&(trial, _)| fits[trial].clean[index]);
        let range = shown.fold((f64::INFINITY, 0.0f64), |(low, high), a| {
            (low.min(a), high.max(a))
        });
        Line {
            wavelength_mm: measures.wavelengths_mm[index],
            phase_turns,
            harmonic_of: line.harmonic_of,
            phase_agreement,
            shown_at_speeds: line.found.speeds,
            amplitude_range_m_s2: (range.0.min(range.1), range.1),
            wander: None,
        }
    });
    let findings = Arc::new(Findings {
        lines: lines.collect(),
        time_locked_hz,
        speed_scatter: measures.speed_scatter,
        followed_trials: fits.iter().filter(|fit| fit.was_followed).count(),
        none_because: None,
        wanders: Vec::new(),
    });
    fits.into_iter()
        .zip(measures.speed_ratios)
        .map(|(fit, speed_ratio)| TrialLines {
            findings: Arc::clone(&findings),
            amplitudes_m_s2: fit.clean,
            speed_ratio,
        })
        .collect()
}

/// Phase of harmonic `number` at the place where its fundamental's sine begins, turns, and how far the trials agree on
/// it, from the amplitudes of fundamental and harmonic in each.
fn relative_phase(
    pairs: impl Iterator<Item = (Complex<f64>, Complex<f64>)>,
    number: u32,
) -> (f64, f64) {
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

/// Removes lines of these wavelengths from `signal`, recorded at `speed_mm_s`, as the samples of `ranges` have them.
fn removed_from(
    signal: &mut [f64],
    ranges: &[Range<usize>],
    speed_mm_s: f64,
    wavelengths_mm: &[f64],
) -> Fitted {
    let mut fitted = Fitted {
        amplitudes: vec![None; wavelengths_mm.len()],
        clean: vec![None; wavelengths_mm.len()],
        was_followed: false,
    };
    let held = told_apart(speed_mm_s, signal.len(), wavelengths_mm);
    if held.is_empty() || LineSpectrum::of(signal).is_none() {
        return fitted;
    }
    let mut place_mm = steady_mm(speed_mm_s, signal.len());
    let at = |place_mm: &[f64]| -> Vec<Vec<f64>> {
        held.iter()
            .map(|&line| turns(place_mm, wavelengths_mm[line]))
            .collect()
    };
    // What was followed once, with its harmonics blurred, is followed more closely from there.
    for _ in 0..FOLLOWED_TIMES {
        let fit = amplitudes(signal, ranges, &at(&place_mm));
        // The line whose phase tells most about place: the strongest for its wavelength.
        let tells = |i: usize| fit[i].norm() / wavelengths_mm[held[i]];
        let best = (0..held.len()).max_by(|&a, &b| tells(a).total_cmp(&tells(b)));
        let wander =
            best.and_then(|best| followed(signal, &mut place_mm, wavelengths_mm[held[best]]));
        if wander.is_none() {
            break;
        }
        fitted.was_followed = true;
    }
    let turns = at(&place_mm);
    let fit = amplitudes(signal, ranges, &turns);
    let mut rest = signal.to_vec();
    for (amplitude, turns) in fit.iter().zip(&turns) {
        subtract(&mut rest, *amplitude, turns);
    }
    let Some(spectrum) = LineSpectrum::of(&rest) else {
        // Nothing but lines.
        for (&line, amplitude) in held.iter().zip(&fit) {
            fitted.amplitudes[line] = Some(*amplitude);
            fitted.clean[line] = Some(amplitude.norm());
        }
        signal.copy_from_slice(&rest);
        return fitted;
    };
    let samples: usize = ranges.iter().map(ExactSizeIterator::len).sum();
    for ((&line, amplitude), turns) in held.iter().zip(&fit).zip(&turns) {
        let noise = spectrum.noise_amplitude_squared(speed_mm_s / wavelengths_mm[line], samples);
        let clean = (amplitude.norm_sqr() - noise).max(0.0).sqrt();
        // What noise has there stays, so that the rest has no hole.
        let stays = (noise.sqrt() / amplitude.norm().max(f64::MIN_POSITIVE)).min(1.0);
        subtract(signal, *amplitude * (1.0 - stays), turns);
        fitted.amplitudes[line] = Some(*amplitude);
        fitted.clean[line] = Some(clean);
    }
    fitted
}

/// Lines that a recording of so many samples at `speed_mm_s` can hold and tell from longer ones, which come first.
fn told_apart(speed_mm_s: f64, samples: usize, wavelengths_mm: &[f64]) -> Vec<usize> {
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
