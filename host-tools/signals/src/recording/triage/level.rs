//! Verdicts on the level within a trial: parts without a signal, one event that outweighs the rest, a step.
//!
//! The level of real takes at one speed and force varies by 7 dB (standard deviation over 50 ms), so only changes that
//! exceed this by far are findings. The bounds come from 24 real takes, whole and in parts of 2 s.

use stylus_dsp::sums::moments_inlined;
use stylus_dsp::wide;

use super::verdict::{Kind, Span, Verdict};
use model_format::SAMPLE_RATE_HZ;

/// Number of samples of a part in the search for silence: 20 ms.
const SILENCE_PART: usize = 100;

/// How far below the loud parts a silent part must be, dB. Real takes contain up to 60 ms below -45 dB.
const SILENT_DB: f64 = 50.0;

/// Least number of parts of a silence: 0.1 s.
const SILENT_PARTS: usize = 5;

/// How far below the loud parts a steady part must be to count as only the sensor's noise and hum, dB.
const QUIET_DB: f64 = 15.0;

/// Least number of parts of only the sensor's noise: 0.4 s.
const QUIET_PARTS: usize = 20;

/// Number of parts at an end of a quiet run, inside the trial, in which a hand may start or end: 0.1 s.
const QUIET_ENDS: usize = 5;

/// How far below the loud parts fewer parts are enough, dB. Between scratches, noise that is 16 dB below them may be
/// steady for as long.
const DEEP_DB: f64 = 25.0;

/// Least number of parts of only the sensor's noise that are so far below, between these ends: 0.2 s.
const DEEP_PARTS: usize = 10;

/// Largest standard deviation of the levels of the sensor's noise, dB. For parts of 100 samples of white noise it is
/// 0.6 dB.
const QUIET_SPREAD_DB: f64 = 1.3;

/// Number of samples of a part in the search for taps, 10 ms, and number of parts of an event.
const TAP_PART: usize = 50;
const TAP_PARTS: usize = 4;

/// Largest number of taps in a trial that are distinguished from its texture.
const MOST_TAPS: usize = 3;

/// Number of samples before and after an event that also belong to it.
const TAP_MARGIN: usize = 100;

/// Least fraction of the energy that a tap has. With this fraction, its spectrum changes the fitted spectrum by more
/// than 1 dB.
const TAP_SHARE: f64 = 0.25;

/// Least ratio of a tap's energy to that of the next event, dB. The strongest event of real takes is at most 8 dB above
/// the next. The one exception, 10.6 dB, is an impact of the tool.
const TAP_ABOVE_DB: f64 = 9.0;

/// Number of samples of a part in the search for steps: 50 ms.
const STEP_PART: usize = 250;

/// Least number of parts on either side of a step: 0.2 s.
const STEP_PARTS: usize = 4;

/// Least fraction of the levels' variance that a step must explain; real takes reach 0.48.
const STEP_SHARE: f64 = 0.6;

/// Smallest step, dB. It is twice the 3 dB by which a hand's own variation changes the mean of a second.
const STEP_DB: f64 = 6.0;

/// Returns the verdicts on the level of all `axes` together.
pub(super) fn verdicts(axes: &[Vec<f64>]) -> Vec<Verdict> {
    let samples = axes.first().map_or(0, Vec::len);
    let silence = silent_spans(axes, samples);
    let mut verdicts = Vec::new();
    let silent: usize = silence.iter().map(ExactSizeIterator::len).sum();
    // Next to silence, any event would outweigh the rest.
    if 2 * silent < samples {
        verdicts.extend(tap(axes));
    }
    verdicts.extend(change(axes, &silence));
    if !silence.is_empty() {
        let whole = format!(", of {:.3} s", samples as f64 / f64::from(SAMPLE_RATE_HZ));
        let silent = Verdict::on(Kind::PartlySilent, "partly silent", silence);
        verdicts.push(silent.with(&whole));
    }
    verdicts
}

/// Returns the power of each whole part about its own mean, summed over the axes, (m/s²)².
fn powers(axes: &[Vec<f64>], part: usize) -> Vec<f64> {
    let count = axes.first().map_or(0, Vec::len) / part;
    let mut powers = vec![0.0; count];
    wide(
        #[inline(always)]
        || {
            for axis in axes {
                for (power, samples) in powers.iter_mut().zip(axis.chunks_exact(part)) {
                    *power += moments_inlined(samples).variance;
                }
            }
        },
    );
    powers
}

fn decibels(power: f64) -> f64 {
    10.0 * power.max(f64::MIN_POSITIVE).log10()
}

/// Returns the runs of parts that are far below the loudest parts.
fn silent_spans(axes: &[Vec<f64>], samples: usize) -> Vec<Span> {
    let levels: Vec<f64> = powers(axes, SILENCE_PART).into_iter().map(decibels).collect();
    if levels.len() < 2 * SILENT_PARTS {
        return Vec::new();
    }
    let mut sorted = levels.clone();
    sorted.sort_by(f64::total_cmp);
    // A tap of 40 ms in 2 s covers at most three of 100 parts, and does not change this level.
    let loud = sorted[sorted.len() - 1 - sorted.len() * 3 / 100];
    let mut spans = runs(&levels, loud - SILENT_DB, SILENT_PARTS);
    // Texture beside a rest may be 15 dB below the loud parts as well, but is not steady.
    for (below_db, least) in [(QUIET_DB, QUIET_PARTS), (DEEP_DB, DEEP_PARTS)] {
        let is_steady = |part: Span| part.len() >= least && spread(&levels[part]) < QUIET_SPREAD_DB;
        for run in runs(&levels, loud - below_db, QUIET_PARTS) {
            let start = if run.start > 0 { run.start + QUIET_ENDS } else { 0 };
            let end = if run.end < levels.len() {
                run.end - QUIET_ENDS
            } else {
                run.end
            };
            if is_steady(run.clone()) || is_steady(start..end) {
                spans.push(run);
            }
        }
    }
    // Several searches may find the same part.
    spans.sort_by_key(|span| span.start);
    spans.dedup_by(|next, first| {
        let joins = next.start <= first.end;
        if joins {
            first.end = first.end.max(next.end);
        }
        joins
    });
    let end_of = |part: usize| {
        if part == levels.len() {
            samples
        } else {
            part * SILENCE_PART
        }
    };
    spans
        .into_iter()
        .map(|span| span.start * SILENCE_PART..end_of(span.end))
        .collect()
}

/// Returns the runs of at least `least` levels below `bound`.
fn runs(levels: &[f64], bound: f64, least: usize) -> Vec<Span> {
    let mut found = Vec::new();
    let mut first = 0;
    for end in 0..=levels.len() {
        if end < levels.len() && levels[end] < bound {
            continue;
        }
        if end - first >= least {
            found.push(first..end);
        }
        first = end + 1;
    }
    found
}

/// Returns the standard deviation.
fn spread(levels: &[f64]) -> f64 {
    (squares(levels) / levels.len() as f64).sqrt()
}

/// Returns the sum of the squared deviations from the mean.
fn squares(levels: &[f64]) -> f64 {
    let mean = levels.iter().sum::<f64>() / levels.len().max(1) as f64;
    levels.iter().map(|level| (level - mean) * (level - mean)).sum()
}

/// Returns the one to three events with the most energy, if they outweigh all others.
fn tap(axes: &[Vec<f64>]) -> Option<Verdict> {
    let powers = powers(axes, TAP_PART);
    if powers.len() < 10 * TAP_PARTS {
        return None;
    }
    let total: f64 = powers.iter().sum();
    let mut events: Vec<f64> = powers.windows(TAP_PARTS).map(|event| event.iter().sum()).collect();
    // The strongest events that do not overlap, in order of their energy.
    let mut strongest: Vec<(usize, f64)> = Vec::new();
    for _ in 0..=MOST_TAPS {
        let first = (0..events.len()).max_by(|&a, &b| events[a].total_cmp(&events[b]))?;
        strongest.push((first, events[first]));
        // Windows up to one part away from the event belong to it.
        let own = first.saturating_sub(TAP_PARTS + 1)..(first + TAP_PARTS + 2).min(events.len());
        events[own].fill(0.0);
    }
    let above_db = |count: usize| decibels(strongest[count - 1].1) - decibels(strongest[count].1);
    let count = (1..=MOST_TAPS).max_by(|&a, &b| above_db(a).total_cmp(&above_db(b)))?;
    let share = strongest[..count].iter().map(|event| event.1).sum::<f64>() / total;
    let mut spans: Vec<Span> = strongest[..count]
        .iter()
        .map(|&(first, _)| {
            let end = (first + TAP_PARTS) * TAP_PART + TAP_MARGIN;
            (first * TAP_PART).saturating_sub(TAP_MARGIN)..end.min(axes[0].len())
        })
        .collect();
    spans.sort_by_key(|span| span.start);
    (share >= TAP_SHARE && above_db(count) >= TAP_ABOVE_DB).then(|| {
        Verdict::on(Kind::Tap, "tap", spans).with(&format!(
            ", {:.0} % of the energy, {:.0} dB above the next event",
            100.0 * share,
            above_db(count)
        ))
    })
}

/// Returns the step or the straight line that explains most of the level's variation outside `silence`.
fn change(axes: &[Vec<f64>], silence: &[Span]) -> Option<Verdict> {
    let is_silent = |part: usize| {
        let (from, to) = (part * STEP_PART, (part + 1) * STEP_PART);
        silence.iter().any(|span| span.start < to && from < span.end)
    };
    let levels: Vec<(usize, f64)> = powers(axes, STEP_PART)
        .into_iter()
        .map(decibels)
        .enumerate()
        .filter(|(part, _)| !is_silent(*part))
        .collect();
    let values: Vec<f64> = levels.iter().map(|(_, level)| *level).collect();
    if values.len() < 4 * STEP_PARTS {
        return None;
    }
    let all = squares(&values);
    let left = |at: &usize| squares(&values[..*at]) + squares(&values[*at..]);
    let best = (STEP_PARTS..=values.len() - STEP_PARTS).min_by(|a, b| left(a).total_cmp(&left(b)))?;
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let step_db = mean(&values[best..]) - mean(&values[..best]);
    let n = values.len() as f64;
    let moment: f64 = values
        .iter()
        .enumerate()
        .map(|(index, level)| (index as f64 - 0.5 * (n - 1.0)) * level)
        .sum();
    // The straight line is fitted by least squares. The squared deviations of the numbers 0 to n - 1 from their mean
    // add up to n (n² - 1) / 12. The slope is the moment divided by this sum, the explained sum of squares is the
    // squared moment divided by this sum, and the ramp is n - 1 slopes.
    let line = 12.0 * moment * moment / (n * (n * n - 1.0));
    let ramp_db = 12.0 * moment / (n * (n + 1.0));
    let step = all - left(&best);
    let (explained, change_db, place) = if line > step {
        (line, ramp_db, "from beginning to end".to_owned())
    } else {
        let seconds = (levels[best].0 * STEP_PART) as f64 / f64::from(SAMPLE_RATE_HZ);
        (step, step_db, format!("at {seconds:.2} s"))
    };
    (explained >= STEP_SHARE * all && change_db.abs() >= STEP_DB).then(|| {
        let words = format!("level change: {change_db:+.0} dB {place}");
        Verdict::new(Kind::LevelChange, words)
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{bounded_noise, plus};
    use super::*;
    use test_helpers::holds;

    fn scaled(range: Span, by: f64) -> Vec<f64> {
        let mut signal = bounded_noise(1);
        signal[range].iter_mut().for_each(|x| *x *= by);
        signal
    }

    #[test]
    fn a_silent_part_is_found_with_its_ends_also_if_it_is_most_of_the_trial() {
        for silent in [0..1000, 4000..5000, 500..10_000] {
            let found = verdicts(&[scaled(silent.clone(), 1e-4)]);
            let [verdict] = &found[..] else {
                panic!("{found:?}");
            };
            assert_eq!(verdict.kind(), Kind::PartlySilent);
            assert_eq!(verdict.spans(), &[silent][..]);
        }
    }

    /// A hand starts and ends within 0.2 s, or at once.
    #[test]
    fn rests_of_a_noisy_sensor_are_found_at_both_ends_and_between_strokes() {
        let sensor = bounded_noise(2);
        for (rests, starts_with, within, noise) in [
            ([0..2600, 7300..10_000], true, 1000.0, 0.05),
            ([0..0, 3500..6500], false, 1000.0, 0.05),
            ([0..0, 3900..6100], false, 1.0, 0.05),
            ([0..0, 4000..6000], false, 250.0, 0.005),
        ] {
            let slowed = bounded_noise(1).into_iter().enumerate().map(|(n, x)| {
                let away = rests.iter().map(|rest| {
                    if n < rest.start {
                        rest.start - n
                    } else {
                        (n + 1).saturating_sub(rest.end)
                    }
                });
                x * (away.min().unwrap_or(0) as f64 / within).min(1.0)
            });
            let signal = slowed.zip(&sensor).map(|(x, own)| x + noise * own).collect();
            let found = verdicts(&[signal]);
            let spans = found
                .iter()
                .find(|own| own.kind() == Kind::PartlySilent)
                .map_or(&[][..], Verdict::spans);
            let found: Vec<&Span> = rests.iter().filter(|rest| !rest.is_empty()).collect();
            assert_eq!(spans.len(), found.len(), "{spans:?}");
            assert_eq!(spans[0].start == 0, starts_with, "{spans:?}");
            for (span, rest) in spans.iter().zip(found) {
                assert!(
                    span.start.abs_diff(rest.start) <= 300 && span.end.abs_diff(rest.end) <= 300,
                    "{spans:?}"
                );
            }
        }
    }

    #[test]
    fn a_tap_is_found_where_it_is() {
        let burst = bounded_noise(3);
        let tap = (0..150).map(|n| 40.0 * burst[n] * (-(n as f64) / 40.0).exp());
        let late = std::iter::repeat_n(0.0, 6000).chain(tap).chain(std::iter::repeat(0.0));
        let found = verdicts(&[plus(&bounded_noise(1), late)]);
        let [verdict] = &found[..] else {
            panic!("{found:?}");
        };
        assert_eq!((verdict.kind(), verdict.spans().len()), (Kind::Tap, 1));
        assert!(verdict.spans()[0].contains(&6010), "{verdict}");
    }

    #[test]
    fn steps_and_ramps_of_the_level_are_told_apart() {
        let found = verdicts(&[scaled(5000..10_000, 4.0)]);
        let words = found[0].to_string();
        assert!(words.starts_with("level change: +12 dB at 1.0"), "{words}");
        let ramp: Vec<f64> = bounded_noise(1)
            .iter()
            .enumerate()
            .map(|(n, x)| x * (n as f64 / 5000.0).exp())
            .collect();
        holds(&verdicts(&[ramp])[0].to_string(), &["from beginning to end"]);
    }
}
