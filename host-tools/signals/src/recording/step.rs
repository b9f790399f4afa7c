//! The step of a recording's clock, what is missing between its times, and the bunches in which they may come.

use super::uneven::{EVEN, Steps, mean_step};

/// Number of samples after a long step that are examined. The one that is least late shows whether samples are missing,
/// or one time was only late.
const LOOK_AHEAD: usize = 8;

/// Largest fraction of single samples that may be missing before they count as gaps.
pub(super) const FEW_LOST: f64 = 0.01;

/// Least resolution of times, as a fraction of a step, at which single steps show nothing, and the number of units of
/// that resolution over which steps are then taken.
const COARSE: (f64, f64) = (0.25, 64.0);

/// Number of times of a block in which a clock drifts little, and least number of later times among twice
/// [`LOOK_AHEAD`] where samples are missing.
const BLOCK: usize = 96;
const LEAST_LATER: usize = 3;

/// Largest deviation of a step from a multiple of the resolution, in its units, at which times show each step exactly.
const BEAT: f64 = 2e-3;

/// Numbers of times whose usual lateness is compared: where steps below half of the usual one are rarer than one in
/// [`FEWEST_SHORT`], and where they are not.
const LEVEL: (usize, usize) = (4, 32);
const FEWEST_SHORT: usize = 256;

/// Least step before which samples may be missing, and least change of the usual lateness there, in steps.
const LONG: f64 = 1.25;
const LEAST_LATE: f64 = 0.75;

/// Number of times that a clock's step is estimated.
const ROUNDS: usize = 3;

/// Largest drift of a clock that is followed, as a fraction of a step per sample.
const DRIFT: f64 = 1e-3;

/// Largest number of decimals of a time that come from its clock. Further decimals are round-off of a sum.
const MOST_DECIMALS: usize = 9;

/// Number of times in a block whose digits are counted, and number of these blocks.
pub(super) const DIGITS: usize = 64;

/// Samples that are missing after a row.
pub(super) struct Missing {
    /// Index of the row among the rows that are kept.
    pub after: usize,
    /// Number of missing samples, at least one.
    pub count: usize,
}

/// A clock, as the times of samples show it.
pub(super) struct Clock {
    /// Step between samples, in the unit of the times.
    pub step: f64,
    /// What is missing, in the order of the times.
    pub missing: Vec<Missing>,
    /// True if samples are even to within the resolution of their times.
    pub is_even: bool,
}

impl Clock {
    /// Estimates the clock of ascending `times`, at least two, with this `resolution`. If they are only those of
    /// changes, the shortest step is the clock's.
    pub fn of(times: &[f64], resolution: f64, are_changes: bool) -> Self {
        let mean = mean_step(times);
        let (least, units) = COARSE;
        let is_coarse = resolution > least * mean || are_changes;
        let by_width = |width: usize| {
            let steps = || times.windows(width + 1).map(|pair| pair[width] - pair[0]);
            let usual = Steps::of(times, width);
            let (mut step, mut count) = (0.0, 0.0);
            for held in steps().filter(|&step| usual.hold(step)) {
                (step, count) = (step + held, count + width as f64);
            }
            step = if count > 0.0 { step / count } else { mean };
            if are_changes {
                step = steps().fold(f64::INFINITY, f64::min);
            }
            let mut clock = Self::by_step(times, step, resolution, is_coarse, are_changes);
            // Among even steps, a gap or a time out of place does not make the others uneven.
            clock.is_even |= is_coarse || (usual.unevenness < EVEN && !steps().all(|step| usual.hold(step)));
            clock
        };
        if !is_coarse || are_changes {
            return by_width(1);
        }
        let many = by_width(((units * resolution / mean).ceil() as usize).clamp(1, (times.len() / 4).max(1)));
        // Digits make single steps uneven, and many steps together hide that samples are missing. A clock that is off
        // by little cannot be told from few missing samples.
        let single = (resolution < LONG * mean).then(|| by_width(1));
        let most = (FEW_LOST * times.len() as f64).max(2.0 * many.missing.len() as f64);
        single
            .filter(|single| single.missing.len() as f64 <= most)
            .unwrap_or(many)
    }

    /// Estimates the clock of `times` from about its `step`.
    fn by_step(times: &[f64], mut step: f64, resolution: f64, is_coarse: bool, are_changes: bool) -> Self {
        let (mut missing, mut widest) = (Vec::new(), 0.0);
        // Again, because the step shows what is missing, and what is missing shows the step.
        for _ in 0..ROUNDS {
            let units = step / resolution;
            let is_exact = are_changes || units > 0.5 && (units - units.round()).abs() < BEAT;
            let short = times.windows(2).filter(|pair| pair[1] - pair[0] < 0.5 * step);
            let late = if is_coarse && !is_exact {
                Late::Within(usual_margin(times, step, resolution))
            } else if are_changes {
                Late::About(1)
            } else if FEWEST_SHORT * short.count() > times.len() {
                Late::About(LEVEL.1)
            } else {
                Late::About(LEVEL.0)
            };
            (missing, widest) = walked(times, step, &late);
            let (mut time, mut count) = (times[times.len() - 1] - times[0], times.len() - 1);
            for gap in &missing {
                // After a long gap, a clock may begin anew at any time.
                let own = times[gap.after + 1] - times[gap.after];
                if own > LOOK_AHEAD as f64 * step {
                    time -= own;
                    count -= 1;
                } else {
                    count += gap.count;
                }
            }
            if count > 0 {
                step = time / count as f64;
            }
        }
        Self {
            step,
            is_even: widest <= 2.0 * (resolution + EVEN * step),
            missing,
        }
    }
}

/// How late the times of a clock are.
enum Late {
    /// By anything up to this, because of their digits.
    Within(f64),
    /// As much as the usual one among this many times.
    About(usize),
}

/// Walks along `times` by `step`. Returns the samples that are missing, and the largest spread of lateness between
/// them.
fn walked(times: &[f64], step: f64, late: &Late) -> (Vec<Missing>, f64) {
    let (mut missing, mut shift, mut widest) = (Vec::<Missing>::new(), 0.0, 0.0f64);
    let (mut low, mut high, mut first) = (0.0f64, 0.0f64, 0);
    let own = |row: usize| times[row] - times[row - 1];
    let end = |row: usize| row.min(times.len());
    // How late the times before are.
    let mut past = vec![0.0];
    // The latest time before, and the latest that is possible after the earliest.
    let (mut least, mut most) = match late {
        Late::Within(margin) => (0.0f64, *margin),
        Late::About(_) => (0.0, 0.0),
    };
    for row in 1..times.len() {
        let lateness = |row: usize| times[row] - times[0] - step * (row as f64 + shift);
        let (least_drift, most_drift) = (least - DRIFT * step, most + DRIFT * step);
        let count = match *late {
            Late::Within(_) if own(row) > step && lateness(row) > most_drift => {
                // A single time may be late; where samples are missing, some of each few are later than all before.
                let later = (row..end(row + 2 * LOOK_AHEAD)).map(|row| lateness(row) - most_drift);
                let latest = later.clone().fold(0.0, f64::max);
                let is_lost = later.filter(|late| *late > 0.0).count() >= LEAST_LATER && latest > 0.4 * step;
                if is_lost { (latest / step).round().max(1.0) } else { 0.0 }
            }
            Late::About(size) if own(row) > LONG * step => {
                // After a late time, steps are short; where the longest step is, samples are missing.
                let is_longest = (row + 1..end(row + size.min(LEVEL.0))).all(|next| own(next) < own(row) + 0.25 * step);
                let before = usual(past[row.saturating_sub(size).max(first)..].to_vec());
                let near = [0..LOOK_AHEAD, 0..size, size..2 * size]
                    .map(|rows| end(row + rows.start)..end(row + rows.end))
                    .into_iter()
                    .filter(|rows| !rows.is_empty());
                let ahead = near
                    .map(|rows| usual(rows.map(lateness).collect()))
                    .fold(f64::INFINITY, f64::min);
                let is_lost = is_longest && ahead - before > LEAST_LATE * step;
                if is_lost {
                    ((ahead - before) / step).round()
                } else {
                    0.0
                }
            }
            _ => 0.0,
        };
        if count >= 1.0 {
            missing.push(Missing {
                after: row - 1,
                // More than there are rows are refused, so their number need not be known, and no sum overflows.
                count: (count as usize).min(times.len() + 1),
            });
            shift += count;
            (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
            if own(row) > LOOK_AHEAD as f64 * step {
                first = row;
            }
        }
        let mut now = times[row] - times[0] - step * (row as f64 + shift);
        if let Late::Within(margin) = late {
            if let Some(last) = missing.last_mut()
                && now + margin < least_drift
                && row - last.after < 2 * LOOK_AHEAD
            {
                // Some of the samples are missing later than the first of them.
                let early = ((least_drift - now - margin) / step)
                    .ceil()
                    .min(last.count as f64 - 1.0);
                last.count -= early as usize;
                shift -= early;
                now += early * step;
            }
            (least, most) = if now + margin < least_drift {
                (now, now + margin)
            } else {
                (least_drift.max(now.min(most_drift)), most_drift.min(now + margin))
            };
        }
        past.push(now);
        (low, high) = (low.min(now), high.max(now));
        widest = widest.max(high - low);
    }
    (missing, widest)
}

/// Returns the mean of the middle half of `values`, of which there is at least one.
fn usual(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let outer = values.len() / 4;
    let middle = &values[outer..values.len() - outer];
    middle.iter().sum::<f64>() / middle.len() as f64
}

/// Returns how late times of a clock with this `step` may be, because of their `resolution` and as they usually are in
/// a block.
fn usual_margin(times: &[f64], step: f64, resolution: f64) -> f64 {
    let spread = |block: &[f64]| {
        let late = block.iter().enumerate().map(|(n, time)| time - step * n as f64);
        let least = late.clone().fold(f64::INFINITY, f64::min);
        late.fold(f64::NEG_INFINITY, f64::max) - least
    };
    let mut spreads: Vec<f64> = times.chunks(BLOCK).map(spread).collect();
    let middle = spreads.len() / 2;
    let usual = *spreads.select_nth_unstable_by(middle, f64::total_cmp).1;
    usual.max(resolution) + 0.1 * step
}

/// Returns the resolution of `times`: the last decimal that they have everywhere, because some programs write as many
/// digits of a large number as of a small one.
pub(super) fn resolution(times: &[f64]) -> f64 {
    let decimals = |time: &f64| {
        // The shortest decimal form has the digits that were written.
        time.to_string().split_once('.').map_or(0, |(_, digits)| digits.len())
    };
    let size = DIGITS.min(times.len());
    let fewest = times
        .chunks_exact(size)
        .step_by(times.len().div_ceil(size * DIGITS))
        .filter_map(|block| block.iter().map(decimals).max())
        .min();
    10f64.powi(-(fewest.unwrap_or(0).min(MOST_DECIMALS) as i32))
}

/// Returns the even step that fits `times` best by least squares, for times in bunches or late times.
pub(super) fn slope(times: &[f64]) -> f64 {
    let middle = (times.len() - 1) as f64 / 2.0;
    let first = times[0];
    let (mut product, mut square) = (0.0, 0.0);
    for (n, time) in times.iter().enumerate() {
        let place = n as f64 - middle;
        product += place * (time - first);
        square += place * place;
    }
    product / square
}

/// Least number of bunches that establish a habit.
const LEAST_BUNCHES: usize = 8;

/// Largest number of samples in a bunch: the length of a sensor's queue.
pub(super) const MOST_OF_BUNCH: usize = 128;

/// Least ratio of the step between bunches to the mean step, and least fraction of the total time in these steps.
const BETWEEN_BUNCHES: (f64, f64) = (1.4, 0.4);

/// Least fraction of the bunches whose number of samples is within a quarter of the usual number.
const ALIKE: f64 = 0.8;

/// Determines whether `times` come in bunches, for example because a sensor's queue is read: short steps, with long
/// steps at regular intervals. Returns the usual number of samples in a bunch, and the usual step between bunches.
pub(super) fn bunch(times: &[f64]) -> Option<(usize, f64)> {
    let total = times[times.len() - 1] - times[0];
    let mean = total / (times.len() - 1) as f64;
    let (least, least_share) = BETWEEN_BUNCHES;
    let long: Vec<usize> = (1..times.len())
        .filter(|&n| times[n] - times[n - 1] > least * mean)
        .collect();
    let mut sizes: Vec<usize> = long.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if sizes.len() < LEAST_BUNCHES {
        return None;
    }
    let mut steps: Vec<f64> = long.iter().map(|&n| times[n] - times[n - 1]).collect();
    let between: f64 = steps.iter().sum();
    let middle = sizes.len() / 2;
    let size = *sizes.select_nth_unstable(middle).1;
    let alike = sizes.iter().filter(|own| 4 * own.abs_diff(size) <= size).count();
    let is_habit = alike as f64 >= ALIKE * sizes.len() as f64 && between >= least_share * total;
    let apart = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    (is_habit && (2..=MOST_OF_BUNCH).contains(&size)).then_some((size, apart))
}
