//! Recordings of a sensor that was read faster than it samples, at any ratio. Each value is held until the next one.
//!
//! A row of such a recording either repeats the previous row or contains the sensor's next sample. If the sensor has
//! its own clock, the changes come in even steps, so the spectrum of their pattern has a line at the sensor's sample
//! rate. Equal neighbours from a coarse converter come at irregular times and cause no line.

use core::f64::consts::PI;

use stylus_dsp::fourier;

use super::rate::RATES_HZ;

/// Number of rows from which a spectrum of changes is computed. Clocks that differ by 100 ppm drift by less than a row
/// in this time.
const BLOCK: usize = 4096;

/// Least number of changes, and of repetitions, in a block.
const LEAST: f64 = 64.0;

/// Least fraction of the sensor's samples that differ from the previous sample.
const LEAST_CHANGING: f64 = 0.75;

/// Range of the power of a held sensor's line, relative to the line of an ideally even pattern. At a ratio of two, the
/// line has 2.5 times that power, because it coincides with its image. For patterns that do not come from a clock, at
/// most a quarter was observed.
const LINE: (f64, f64) = (0.4, 3.0);

/// Least ratio of the line's power to the mean of the bins around it, and the range of these bins. Equal neighbours
/// that come in groups, for example at clipped peaks, have a broad spectrum.
const OVER_AROUND: f64 = 20.0;
const AROUND: std::ops::RangeInclusive<usize> = 4..=40;

/// Least ratio of the difference between the samples before and after a repetition to the mean step, and least ratio of
/// the mean step to the step of the converter. Coarse samples of a tone also repeat in even steps, around its peaks.
/// There, the samples before and after differ by at most two steps of the converter.
const LEAST_STEP: f64 = 0.7;
const LEAST_FINENESS: f64 = 4.0;

/// The samples that the sensor itself took.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polled {
    /// Sample rate of the sensor, Hz.
    pub rate_hz: f64,
    /// Samples of each channel, without repetitions.
    pub channels: Vec<Vec<f64>>,
}

/// Finds the samples of a sensor whose values are held in `channels`, which have equal lengths and were read at
/// `rate_hz`; `None` if values are not held.
pub(super) fn polled(channels: &[Vec<f64>], rate_hz: f64) -> Option<Polled> {
    let rows = channels.first()?.len();
    let is_change = |row: usize| channels.iter().any(|axis| axis[row] != axis[row - 1]);
    let changes: Vec<usize> = (1..rows).filter(|&row| is_change(row)).collect();
    let block = rows.min(BLOCK);
    let rare = changes.len().min(rows - changes.len());
    if (rare * block) as f64 / (rows as f64) < LEAST {
        return None;
    }
    let rate = line(&changes, rows, block)?;
    if !steps_over_repetitions(channels, &changes) {
        return None;
    }
    let (taken, interval) = numbered(&changes, 1.0 / rate);
    let own_hz = rate_hz / interval;
    let channels = channels.iter();
    RATES_HZ.contains(&own_hz).then(|| Polled {
        rate_hz: own_hz,
        channels: channels
            .map(|axis| taken.iter().map(|&row| axis[row]).collect())
            .collect(),
    })
}

/// Returns the frequency, per row, of the line of a held sensor in the pattern of `changes`; `None` if there is no
/// line.
///
/// A pattern of changes in even steps, r per row, has a line of amplitude sin(πr)/π at r, and its image at 1 - r.
fn line(changes: &[usize], rows: usize, block: usize) -> Option<f64> {
    let power = mean_power(changes, rows, block);
    let share = changes.len() as f64 / rows as f64;
    let (least, most) = (share, (share / LEAST_CHANGING).min(f64::midpoint(1.0, share)));
    let bin = 1.0 / block as f64;
    let at = |index: usize| power.get(index).copied().unwrap_or(0.0);
    let candidates = (1..power.len()).filter_map(|index| {
        let (here, next) = (at(index), at(index + 1));
        let (a, b) = (here.sqrt(), next.sqrt());
        let between = (index as f64 + b / (a + b).max(f64::MIN_POSITIVE)) * bin;
        // Of a line and its image, the slower is taken, because the faster would leave more of the sensor's samples
        // unchanged.
        let both = [between.min(1.0 - between), between.max(1.0 - between)];
        let in_range = |rate: &f64| (least - bin..=most).contains(rate);
        let rate = both.into_iter().find(in_range)?;
        let even = (block as f64 * (PI * rate).sin() / PI).powi(2);
        // A line between two bins has most of its power in both together.
        Some(((here + next) / even, rate, index))
    });
    let (strength, rate, index) = candidates.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let around: Vec<f64> = AROUND
        .flat_map(|off| [index.checked_sub(off), Some(index + off)])
        .flatten()
        .filter_map(|index| power.get(index).copied())
        .collect();
    let mean = around.iter().sum::<f64>() / around.len().max(1) as f64;
    let stands_out = at(index) + at(index + 1) >= OVER_AROUND * mean;
    (stands_out && (LINE.0..=LINE.1).contains(&strength)).then_some(rate)
}

/// Returns the mean power of the pattern of `changes` over the whole blocks in `rows`, per bin of the transform.
fn mean_power(changes: &[usize], rows: usize, block: usize) -> Vec<f64> {
    let mut pattern = vec![0.0; block];
    let mut power = vec![0.0; block / 2 + 1];
    let blocks = rows / block;
    for first in (0..blocks).map(|number| number * block) {
        let from = changes.partition_point(|&row| row < first);
        let to = changes.partition_point(|&row| row < first + block);
        // Without the mean, bin 0 does not count among the bins around a slow line.
        pattern.fill(-((to - from) as f64) / block as f64);
        for row in &changes[from..to] {
            pattern[row - first] += 1.0;
        }
        for (sum, value) in power.iter_mut().zip(fourier::forward(&mut pattern)) {
            *sum += value.norm_sqr() / blocks as f64;
        }
    }
    power
}

/// Returns whether the samples before and after a repetition differ as much as neighbours do.
fn steps_over_repetitions(channels: &[Vec<f64>], changes: &[usize]) -> bool {
    let mean = |differences: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = differences.fold((0.0, 0), |(sum, count), x| (sum + x, count + 1));
        sum / f64::from(count.max(1))
    };
    let apart = |a: usize, b: usize| -> f64 { channels.iter().map(|axis| (axis[a] - axis[b]).abs()).sum() };
    let repeated = changes.windows(2).filter(|pair| pair[1] - pair[0] > 1);
    let around = mean(&mut repeated.map(|pair| apart(pair[1], pair[0] - 1)));
    let mut steps = changes.iter().map(|&row| apart(row, row - 1));
    let least = steps.clone().fold(f64::INFINITY, f64::min);
    let step = mean(&mut steps);
    around >= LEAST_STEP * step && step >= LEAST_FINENESS * least
}

/// Returns the row of each of the sensor's samples, and the mean interval between samples in rows. They follow from the
/// rows of the `changes`, which come about every `interval` rows. A sample that equals the previous one has the row of
/// the previous one.
fn numbered(changes: &[usize], interval: f64) -> (Vec<usize>, f64) {
    let [first, later @ ..] = changes else {
        return (vec![0], interval);
    };
    let mut taken = vec![first - 1, *first];
    // Position, in rows, at which the sensor took its sample: between the row before a change and the row of the
    // change.
    let begin = *first as f64 - 0.5;
    let mut at = begin;
    let mut count = 0.0;
    for &row in later {
        let steps = ((row as f64 - 0.5 - at) / interval).round().max(1.0);
        // The clamp follows a clock that drifts against the reader's.
        at = (at + steps * interval).clamp(row as f64 - 1.0, row as f64);
        count += steps;
        let last = taken[taken.len() - 1];
        taken.extend(std::iter::repeat_n(last, steps as usize - 1));
        taken.push(row);
    }
    let mean = if count > 0.0 { (at - begin) / count } else { interval };
    (taken, mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::{near, noise};

    /// Low-pass filtered noise as the samples of an axis, rounded to multiples of `step`.
    fn axis(seed: u64, samples: usize, step: f64) -> Vec<f64> {
        noise(seed, samples + 2)
            .windows(3)
            .map(|w| w[0] + 1.4 * w[1] + 0.6 * w[2])
            .map(|x| (x / step).round() * step)
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// The sensor may be coarse, so that some of its samples equal the previous one.
        #[test]
        fn a_sensor_that_was_read_faster_than_it_samples_is_found_with_its_rate_at_any_ratio(
            ratio in prop_oneof![1.03..2.5f64, 2.0..40.0f64, (2u32..30).prop_map(f64::from)],
            phase in 0.0..1.0f64,
            step in prop::sample::select(vec![1e-6, 0.05]),
            seed in 0u64..1000,
        ) {
            let samples = 9000;
            let own: Vec<Vec<f64>> = (0..2).map(|of| axis(seed + 1000 * of, samples, step)).collect();
            let rows = ((samples - 1) as f64 * ratio).min(20_000.0) as usize;
            let held = |axis: &Vec<f64>| -> Vec<f64> {
                (0..rows).map(|row| axis[(row as f64 / ratio + phase) as usize]).collect()
            };
            let held: Vec<Vec<f64>> = own.iter().map(held).collect();
            let Polled { rate_hz, channels } = polled(&held, 5000.0).expect("held");
            let expected = 5000.0 / ratio;
            prop_assert!((rate_hz / expected - 1.0).abs() < 2e-3, "{} {}", rate_hz, expected);
            // All of its samples except a few at the ends, each once.
            let middle = &own[0][200..300.min(rows / ratio as usize)];
            let is_there = channels[0].windows(middle.len()).any(|part| part == middle);
            prop_assert!(is_there || middle.is_empty(), "{}", ratio);
        }

        #[test]
        fn equal_neighbours_of_coarse_samples_and_of_tones_are_not_held(
            step in 0.05..1.5f64, pole in -0.9..0.95f64, hz in 30.0..1200.0f64, level in 2.0..100.0f64,
        ) {
            let mut state = 0.0;
            let coarse: Vec<f64> = noise(7, 20_000)
                .iter()
                .map(|x| {
                    state = pole * state + x;
                    (state / step).round() * step
                })
                .collect();
            prop_assert!(polled(&[coarse], 5000.0).is_none());
            let tone = |(n, x): (usize, &f64)| {
                (level * (2.0 * PI * hz / 5000.0 * n as f64).sin() + 0.05 * x).round()
            };
            let tone: Vec<f64> = noise(8, 20_000).iter().enumerate().map(tone).collect();
            prop_assert!(polled(&[tone], 5000.0).is_none());
            let mut before = (0.0, 0.0);
            let ringing: Vec<f64> = noise(9, 20_000).into_iter().map(|x| {
                let now = x * x.abs() + 1.96 * (2.0 * PI * hz / 5000.0).cos() * before.0 - 0.96 * before.1;
                before = (now, before.0);
                now
            }).collect();
            let peak = ringing.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
            let clipped = ringing.iter().map(|x| x.clamp(-0.5 * peak, 0.5 * peak)).collect();
            prop_assert!(polled(&[clipped], 5000.0).is_none());
        }
    }

    #[test]
    fn a_drifting_clock_is_followed() {
        let own = axis(1, 9000, 1e-6);
        let held: Vec<f64> = (0..20_000)
            .map(|row| f64::from(row) / 5000.0)
            .map(|t| own[(2000.0 * t * (1.0 + 1e-4 * t)) as usize])
            .collect();
        let found = polled(&[held], 5000.0).unwrap();
        near(found.rate_hz, 2000.8, 1.0);
        assert!(found.channels[0].len().abs_diff(8003) < 5);
        assert_eq!(polled(&[], 5000.0), None);
        assert_eq!(polled(&[vec![0.0; 10_000]], 5000.0), None);
    }
}
