//! Samples with times: selects the part that is used, and determines its rate and the faults in the times.
//!
//! Missing samples are filled in, so that the index of a sample determines its time. A single missing sample is
//! interpolated. Longer gaps are filled from their surroundings, and triage cuts them. Rows of other sensors, which
//! repeat a sample or have none, are removed.

use core::f64::consts::FRAC_PI_2;
use std::ops::Range;

use super::defects::{Gap, Timing};
use super::joined::own_rows;
use super::rate::SampleRate;
use super::source::{Cut, Source};
use super::time_unit::TimeUnit;
use super::uneven::{EVEN, Steps, are_even};
use super::unit::Stated;
use crate::support::csv_table::CsvTable;
use crate::support::error::{Error, Result};

/// Number of samples after a long step that are examined. The one that is least late shows whether samples are missing,
/// or one time was only late.
const LOOK_AHEAD: usize = 8;

/// Largest fraction of single samples that may be missing before they count as gaps.
const FEW_LOST: f64 = 0.01;

/// Facts about a file's times, in addition to the times themselves.
pub(super) struct Clock<'a> {
    /// Name of the column of times.
    pub column: &'a str,
    /// Unit of the times, if it was given or is in the column's name.
    pub unit: Option<TimeUnit>,
    /// True if the samples are evenly spaced, regardless of the times.
    pub is_even: bool,
    /// The sample rate that was given. The times have priority if they can be used, unless `is_even`.
    pub rate: Option<SampleRate>,
}

/// Returns the samples of `channels` within `cut`. `times` has one time for each row of `table` below its header.
///
/// # Errors
/// There are fewer than two times, or they give a rate that is not possible for a recording; or, within the part, they
/// do not rise, come in bunches with gaps between them, or consist mostly of gaps. Where one line is at fault, the
/// error states it. With a given rate, such samples are evenly spaced at it instead.
pub(super) fn source(
    table: &CsvTable,
    clock: &Clock<'_>,
    times: &[f64],
    channels: Vec<Vec<f64>>,
    cut: &Cut,
) -> Result<Source> {
    let (unit, is_guess) = clock.unit_of(times);
    let layout = Stamps {
        table,
        clock,
        times,
        unit,
    }
    .layout(&channels, cut);
    let mut layout = match (layout, clock.rate) {
        // The times were needed for their rate only.
        (Err(_), Some(rate)) => return Ok(even(rate, channels, cut)),
        (layout, _) => layout?,
    };
    layout.timing.guessed_unit = is_guess.then_some(unit);
    Ok(layout.laid_out(channels))
}

/// Returns the samples of `channels` within `cut`, which are evenly spaced at `rate`. A row without a sample is a
/// missing sample.
pub(super) fn even(rate: SampleRate, channels: Vec<Vec<f64>>, cut: &Cut) -> Source {
    Layout::even(rate, &channels, cut).laid_out(channels)
}

/// Returns true if the row has a sample of every axis.
fn is_sampled(channels: &[Vec<f64>], row: usize) -> bool {
    channels.iter().all(|axis| axis[row].is_finite())
}

impl Clock<'_> {
    /// Returns the unit of `times`, and true if no name or option states it and it is not seconds.
    fn unit_of(&self, times: &[f64]) -> (TimeUnit, bool) {
        if let Some(unit) = self.unit {
            return (unit, false);
        }
        if times.len() < 2 {
            return (TimeUnit::S, false);
        }
        // If a sensor's queue is read at once, the usual step is short or zero, and only the mean shows the rate.
        let (mean, usual) = (mean_step(times), Steps::of(times).usual_s);
        let by_rate = |rate: SampleRate| TimeUnit::of_steps(mean, usual, Some(rate.hz()));
        if let Some(unit) = self.rate.and_then(by_rate) {
            return (unit, false);
        }
        let unit = TimeUnit::of_steps(mean, usual, None).unwrap_or(TimeUnit::S);
        (unit, unit != TimeUnit::S)
    }
}

/// Samples that are missing after a row.
struct Missing {
    /// Index of the row among the rows that are kept.
    after: usize,
    /// Number of missing samples, at least one.
    count: usize,
}

/// Rows of a file that are kept.
enum Rows {
    Range(Range<usize>),
    Some(Vec<usize>),
}

/// How a file's rows become evenly spaced samples.
struct Layout {
    rate: SampleRate,
    rows: Rows,
    missing: Vec<Missing>,
    /// Times of the rows, s, if they are uneven.
    times_s: Option<Vec<f64>>,
    timing: Timing,
}

/// Times of a file in their unit.
struct Stamps<'a> {
    table: &'a CsvTable,
    clock: &'a Clock<'a>,
    times: &'a [f64],
    unit: TimeUnit,
}

impl Stamps<'_> {
    fn layout(&self, channels: &[Vec<f64>], cut: &Cut) -> Result<Layout> {
        let times = self.times;
        if times.len() < 2 {
            let problem = match times {
                [] => "holds no samples",
                _ => "holds one sample, whose time tells no sample rate: record for longer",
            };
            return Err(Error::file(self.table.path(), problem));
        }
        if self.clock.is_even {
            let rate = self.clock.rate.map_or_else(|| self.rate_of(slope(times)), Ok)?;
            return Ok(Layout::even(rate, channels, cut));
        }
        let steps = Steps::of(times);
        let hold = times.windows(2).all(|pair| steps.hold(pair[1] - pair[0]))
            && (0..times.len()).all(|row| is_sampled(channels, row));
        if hold && own_rows(times, channels, 0..times.len()).is_none() {
            return self.without_gaps(channels, cut);
        }
        self.with_gaps(channels, self.part(cut, steps.usual_s))
    }

    /// Returns the layout of times without gaps and without rows of other sensors.
    fn without_gaps(&self, channels: &[Vec<f64>], cut: &Cut) -> Result<Layout> {
        let times = self.times;
        // Over the whole duration, late times in between do not count.
        let step = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let rate = self.rate_of(step)?;
        let mut layout = Layout::even(rate, channels, cut);
        // Conversion takes whole rates, so samples at any other are moved like uneven ones.
        if let Rows::Range(part) = &layout.rows
            && (rate.hz().fract() != 0.0 || !are_even(times))
        {
            layout.timing.bunch = bunch(times).map(|(size, _)| size);
            layout.times_s = Some(times[part.clone()].iter().map(|t| self.seconds(*t)).collect());
        }
        Ok(layout)
    }

    /// Returns the rows whose times are within `cut`.
    fn part(&self, cut: &Cut, step: f64) -> Range<usize> {
        // Half a step is the rounding of [`Cut::frames`].
        let half = if step.is_finite() { 0.5 * step } else { 0.0 };
        let from = |first: usize, seconds: f64| {
            if seconds.is_infinite() {
                return self.times.len();
            }
            let least = self.times[0] + seconds * self.unit.per_second() - half;
            let rows = self.times.iter().skip(first);
            // A NaN is refused later.
            let is_before = |time: &&f64| time.is_nan() || **time < least;
            first + rows.take_while(is_before).count()
        };
        let first = from(0, cut.start_s);
        first..from(first, cut.start_s + cut.duration_s)
    }

    /// Returns the layout of the rows of `part`, which has gaps or rows of other sensors.
    fn with_gaps(&self, channels: &[Vec<f64>], part: Range<usize>) -> Result<Layout> {
        self.refuse_falling(channels, part.clone())?;
        let own = own_rows(self.times, channels, part.clone());
        let mut rows = own.unwrap_or_else(|| part.clone().collect());
        let with_empty = rows.len();
        rows.retain(|&row| is_sampled(channels, row));
        let empty = with_empty - rows.len();
        // A row that occurs twice counts once.
        rows.dedup_by(|row, before| self.times[*row] == self.times[*before]);
        let removed = part.len() - rows.len();
        if rows.len() < 2 {
            let problem = "has fewer than two samples in the part that is used: give another start_s or duration_s";
            return Err(Error::file(self.table.path(), problem));
        }
        let times: Vec<f64> = rows.iter().map(|&row| self.times[row]).collect();
        let steps = Steps::of(&times);
        let (step, missing) = missing(&times, steps);
        let bunch = bunch(&times);
        // Between bunches, missing samples cannot be told from the wait for the next bunch.
        if let Some((size, apart)) = bunch.filter(|_| !missing.is_empty()) {
            return Err(Error::file(self.table.path(), self.bunch_fault(&times, size, apart)));
        }
        let rate = self.rate_of(step)?;
        self.refuse_mostly_missing(&rows, &missing, step)?;
        let is_even = steps.unevenness < EVEN || are_even(&times);
        let times_s = (!is_even).then(|| times.iter().map(|t| self.seconds(*t)).collect());
        let refilled: usize = missing.iter().map(|gap| gap.count).sum();
        let timing = Timing {
            // A row without a sample is a loss if a sample is due there; between two samples it is another sensor's
            // row.
            joined_rows: removed - empty.min(refilled),
            bunch: bunch.filter(|_| !is_even).map(|(size, _)| size),
            ..Timing::default()
        };
        Ok(Layout {
            rate,
            rows: Rows::Some(rows),
            missing,
            times_s,
            timing,
        }
        .with_gaps_told())
    }

    /// Converts a time to seconds.
    fn seconds(&self, time: f64) -> f64 {
        if self.unit == TimeUnit::S {
            return time;
        }
        (time - self.times[0]) / self.unit.per_second()
    }

    /// Returns the rate of samples that are `step` apart, rounded to a whole number if it is close to one.
    fn rate_of(&self, step: f64) -> Result<SampleRate> {
        let remedy = format!(
            "column '{}' holds times in {}, so give their unit by --time-unit, or their rate by --sample-rate",
            self.clock.column,
            self.unit.name()
        );
        let rate_hz = near_whole(self.unit.per_second() / step);
        SampleRate::new(rate_hz, &remedy).map_err(|fault| Error::file(self.table.path(), fault))
    }

    /// Refuses times of `part` that do not rise, unless a row occurs twice.
    fn refuse_falling(&self, channels: &[Vec<f64>], part: Range<usize>) -> Result<()> {
        let is_bad = |row: &usize| {
            let step = self.times[*row] - self.times[row - 1];
            // A row without a sample of an axis may be another sensor's at the same time.
            let is_other = |axis: &Vec<f64>| !(axis[*row].is_finite() && axis[row - 1].is_finite());
            let is_same = |axis: &Vec<f64>| axis[*row] == axis[row - 1] || is_other(axis);
            let is_twice = step == 0.0 && channels.iter().all(is_same);
            !(step > 0.0 && step.is_finite() || is_twice)
        };
        let Some(row) = part.clone().skip(1).find(is_bad) else {
            return Ok(());
        };
        let fault = falling(self.clock.column, self.times[row - 1], self.times[row]);
        let remedy = "or give --even-times if samples are even";
        Err(self.error(row, format!("{fault}, {remedy}")))
    }

    /// Refuses `rows` if more samples are missing than present.
    fn refuse_mostly_missing(&self, rows: &[usize], missing: &[Missing], step: f64) -> Result<()> {
        let total: usize = missing.iter().map(|gap| gap.count).sum();
        let Some(longest) = missing.iter().max_by_key(|gap| gap.count) else {
            return Ok(());
        };
        let row = rows[longest.after + 1];
        if total > rows.len() {
            let before = self.times[rows[longest.after]];
            let gap = gap_of(self.clock.column, before, self.times[row], step, self.unit.name());
            let problem = format!(
                "{gap}, and gaps are most of the part that is used: give start_s and duration_s of a part without them"
            );
            return Err(self.error(row, problem));
        }
        Ok(())
    }

    /// Returns the fault of times that come in bunches of `size`, with the usual step `apart` between bunches.
    fn bunch_fault(&self, times: &[f64], size: usize, apart: f64) -> String {
        format!(
            "its times come in bunches of {size}, {apart:.6} {} apart, and tell no sample's own: give --even-times if \
             samples are even, at {:.0} Hz then",
            self.unit.name(),
            near_whole(self.unit.per_second() / slope(times))
        )
    }

    fn error(&self, row: usize, problem: String) -> Error {
        // The header counts as a row, too.
        Error::line(self.table.path(), self.table.line_of_row(row + 1), problem)
    }
}

impl Layout {
    /// Returns the layout of evenly spaced samples at `rate`. Rows of `channels` without a sample are missing
    /// samples, unless most rows have none.
    fn even(rate: SampleRate, channels: &[Vec<f64>], cut: &Cut) -> Self {
        let rows = channels.first().map_or(0, Vec::len);
        let (first, end) = cut.frames(rate.hz());
        let part = first.min(rows)..end.clamp(first.min(rows), rows);
        let mut layout = Self {
            rate,
            rows: Rows::Range(part.clone()),
            missing: Vec::new(),
            times_s: None,
            timing: Timing::default(),
        };
        let length = part.len();
        let kept: Vec<usize> = part.filter(|&row| is_sampled(channels, row)).collect();
        if kept.len() == length || 2 * kept.len() < length {
            return layout;
        }
        let gap = |(after, pair): (usize, &[usize])| Missing {
            after,
            count: pair[1] - pair[0] - 1,
        };
        let gaps = kept.windows(2).enumerate().map(gap);
        layout.missing = gaps.filter(|gap| gap.count > 0).collect();
        layout.rows = Rows::Some(kept);
        layout.with_gaps_told()
    }

    /// Records the missing samples as findings: a few single ones by their number, the others as gaps.
    fn with_gaps_told(mut self) -> Self {
        let missing: usize = self.missing.iter().map(|gap| gap.count).sum();
        let kept = match &self.rows {
            Rows::Range(rows) => rows.len(),
            Rows::Some(rows) => rows.len(),
        };
        let single = self.missing.iter().filter(|gap| gap.count == 1).count();
        let are_few = single as f64 <= FEW_LOST * (kept + missing) as f64;
        let mut before = 0;
        for gap in &self.missing {
            if gap.count > 1 || !are_few {
                self.timing.gaps.push(Gap {
                    start_s: (gap.after + before) as f64 / self.rate.hz(),
                    // A gap reaches from the sample before it to the sample after it.
                    seconds: (gap.count + 1) as f64 / self.rate.hz(),
                });
            }
            before += gap.count;
        }
        self.timing.lost = if are_few { single } else { 0 };
        self.timing.samples = kept + missing;
        self
    }

    /// Arranges the rows of `channels` into evenly spaced samples.
    fn laid_out(self, mut channels: Vec<Vec<f64>>) -> Source {
        let first_frame = match &self.rows {
            Rows::Range(rows) => rows.start,
            Rows::Some(rows) => rows.first().copied().unwrap_or(0),
        };
        for channel in &mut channels {
            match &self.rows {
                Rows::Range(rows) => {
                    channel.truncate(rows.end);
                    channel.drain(..rows.start);
                }
                Rows::Some(rows) => *channel = rows.iter().map(|&row| channel[row]).collect(),
            }
            if !self.missing.is_empty() {
                *channel = filled(channel, &self.missing);
            }
        }
        Source {
            rate: self.rate,
            first_frame,
            times_s: self.times_s.map(|times| {
                spread(&times, &self.missing, |gap, n| {
                    let (before, behind) = (times[gap.after], times[gap.after + 1]);
                    before + (behind - before) * n as f64 / (gap.count + 1) as f64
                })
            }),
            channels,
            truncation: None,
            stated: Stated::default(),
            integers: None,
            remarks: Vec::new(),
            timing: self.timing,
        }
    }
}

/// Returns `samples` with the missing samples filled in. A single one is interpolated by the polynomial through the six
/// samples around it. A longer gap is filled with the reversed samples before and after it, with a crossfade. Then its
/// level and spectrum are those of its surroundings, so that no other defect is found there.
fn filled(samples: &[f64], missing: &[Missing]) -> Vec<f64> {
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    let at = |place: usize| samples[place.min(samples.len() - 1)] - mean;
    spread(samples, missing, |gap, n| {
        let around = (gap.after + 1).checked_sub(3);
        let around = around.and_then(|from| samples.get(from..from + 6));
        if let (1, Some(&[a, b, c, d, e, f])) = (gap.count, around) {
            return 0.75 * (c + d) - 0.3 * (b + e) + 0.05 * (a + f);
        }
        let before = at((gap.after + 1).saturating_sub(n));
        let behind = at(gap.after + 1 + gap.count - n);
        // The squares of both weights sum to one, so the level of two uncorrelated stretches stays.
        let angle = FRAC_PI_2 * n as f64 / (gap.count + 1) as f64;
        mean + before * angle.cos() + behind * angle.sin()
    })
}

/// Inserts missing samples into `values`. `value` is called with the gap and the number, from 1, of the missing sample
/// in it.
fn spread(values: &[f64], missing: &[Missing], value: impl Fn(&Missing, usize) -> f64) -> Vec<f64> {
    let mut all = Vec::with_capacity(values.len() + missing.len());
    let mut from = 0;
    for gap in missing {
        all.extend(&values[from..=gap.after]);
        all.extend((1..=gap.count).map(|n| value(gap, n)));
        from = gap.after + 1;
    }
    all.extend(&values[from..]);
    all
}

/// Returns the mean of the steps between `times` without gaps, and the missing samples.
fn missing(times: &[f64], steps: Steps) -> (f64, Vec<Missing>) {
    let held = times
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|&step| steps.hold(step));
    let (sum, count) = held.fold((0.0, 0), |(sum, count), step| (sum + step, count + 1));
    let step = sum / f64::from(count.max(1));
    let gap = |(after, pair): (usize, &[f64])| {
        if pair[1] - pair[0] <= step || steps.hold(pair[1] - pair[0]) {
            return None;
        }
        // A single late time is followed by a short step.
        let next = times[after + 1..].iter().take(LOOK_AHEAD).enumerate();
        let late = next.map(|(n, time)| time - pair[0] - (n + 1) as f64 * step);
        let count = (late.fold(f64::INFINITY, f64::min) / step).round();
        (count >= 1.0).then_some(Missing {
            after,
            // More than there are rows are refused, so their number need not be known, and no sum of them overflows.
            count: (count as usize).min(times.len() + 1),
        })
    };
    (step, times.windows(2).enumerate().filter_map(gap).collect())
}

/// Number of the longest steps that are left out of a mean, because they may be pauses.
const PAUSES: usize = 8;

/// Returns the mean of the steps between `times`, without the few longest.
fn mean_step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let kept = steps.len() - PAUSES.min(steps.len() / 16);
    steps.select_nth_unstable_by(kept - 1, f64::total_cmp);
    steps[..kept].iter().sum::<f64>() / kept as f64
}

/// Returns the even step that fits `times` best by least squares, for times in bunches or late times.
fn slope(times: &[f64]) -> f64 {
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
const MOST_OF_BUNCH: usize = 128;

/// Least ratio of the step between bunches to the mean step, and least fraction of the total time in these steps.
const BETWEEN_BUNCHES: (f64, f64) = (1.4, 0.4);

/// Least fraction of the bunches whose number of samples is within a quarter of the usual number.
const ALIKE: f64 = 0.8;

/// Determines whether `times` come in bunches, for example because a sensor's queue is read: short steps, with long
/// steps at regular intervals. Returns the usual number of samples in a bunch, and the usual step between bunches.
fn bunch(times: &[f64]) -> Option<(usize, f64)> {
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

/// Rounds `rate_hz` to a whole number if it is close to one, because times are often printed with few digits.
fn near_whole(rate_hz: f64) -> f64 {
    let whole = rate_hz.round();
    if (rate_hz / whole - 1.0).abs() < 1e-3 {
        whole
    } else {
        rate_hz
    }
}

/// Returns the sample rate, Hz, of the times, s, in `column` of `table`, one per row below its header. It is for a
/// recording with a motion, which must not have gaps.
///
/// # Errors
/// There are fewer than two times; or a step differs from the others, with its line.
pub(super) fn even_rate(table: &CsvTable, column: &str, times: &[f64]) -> Result<f64> {
    let path = table.path();
    if times.len() < 2 {
        let problem = "holds one sample, whose time tells no sample rate: record for longer";
        return Err(Error::file(path, problem));
    }
    let steps = Steps::of(times);
    if steps.usual_s <= 0.0 && times[times.len() - 1] > times[0] {
        let problem = format!(
            "most values of {column} repeat the one before, so they have too few digits: give --sample-rate in their \
             place"
        );
        return Err(Error::file(path, problem));
    }
    let bad = |pair: &[f64]| !steps.hold_even(pair[1] - pair[0]);
    if let Some(index) = times.windows(2).position(bad) {
        let (before, time) = (times[index], times[index + 1]);
        let problem = if time > before && steps.usual_s > 0.0 {
            let gap = gap_of(column, before, time, steps.usual_s, "s");
            format!("{gap}; times must rise in even steps: cut the file there, or resample it to even steps")
        } else {
            falling(column, before, time)
        };
        // The header counts as a row, and the fault is in the second row of the step.
        return Err(Error::line(path, table.line_of_row(index + 2), problem));
    }
    Ok((times.len() - 1) as f64 / (times[times.len() - 1] - times[0]))
}

/// Describes, in words, a step from `before` to `time`, in `unit`, that differs from the `usual` step.
fn gap_of(column: &str, before: f64, time: f64, usual: f64, unit: &str) -> String {
    let step = time - before;
    let kind = if step > usual { "a gap" } else { "a short step" };
    format!("{column} is {time} after {before}: {kind} of {step:.6} {unit} where lines are {usual:.6} {unit} apart")
}

/// Returns the fault, in words, of a `time` that is not above the previous time `before`.
fn falling(column: &str, before: f64, time: f64) -> String {
    if time == before {
        format!("{column} is {time} as in the line before: write times with more digits, or remove the line")
    } else {
        format!("{column} is {time} after {before}: times must rise in even steps; cut the file there")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;
    use std::path::Path;
    use test_helpers::holds;
    use test_helpers::near;

    const ALL: Cut = Cut {
        start_s: 0.0,
        duration_s: f64::INFINITY,
    };

    fn table(times: &[f64]) -> CsvTable {
        let rows = times.iter().map(|time| format!("{time},1\n"));
        let text = format!("# x\ntime_s,x\n{}", rows.collect::<String>());
        CsvTable::of(Path::new("a.csv"), text).unwrap()
    }

    fn clock() -> Clock<'static> {
        Clock {
            column: "time_s",
            unit: None,
            is_even: false,
            rate: None,
        }
    }

    fn tone(time: f64) -> f64 {
        (TAU * 23.0 * time).sin() + 0.1 * time
    }

    /// Samples of a slow tone at `times`, s. The times are written multiplied by `factor`.
    fn of(times: &[f64], factor: f64, clock: &Clock<'_>, cut: &Cut) -> Result<Source> {
        let written: Vec<f64> = times.iter().map(|time| time * factor).collect();
        let channels = vec![times.iter().map(|time| tone(*time)).collect()];
        source(&table(&written), clock, &written, channels, cut)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Rows are missing at the beginning of each run; the numbers are the lengths of the runs.
        #[test]
        fn samples_keep_their_places_over_gaps_and_single_losses(
            runs in prop::collection::vec((20usize..400, prop::sample::select(vec![1usize, 1, 1, 2, 5, 40])), 1..8),
            rate_hz in prop::sample::select(vec![400.0, 1344.0, 5000.0]),
            off in 0.0..0.3f64,
        ) {
            let mut places = Vec::new();
            let mut next = 0;
            for &(kept, lost) in &runs {
                places.extend(next..next + kept);
                next += kept + lost;
            }
            places.extend(next..next + 300);
            // Some times are late by a fraction of a step, but they are even on average.
            let late = |n: usize| if n % 37 == 5 { off } else { 0.0 };
            let times: Vec<f64> = places.iter().map(|&n| n as f64 / rate_hz).collect();
            let stamps: Vec<f64> = places.iter().map(|&n| (n as f64 + late(n)) / rate_hz).collect();
            let channels = vec![times.iter().map(|time| tone(*time)).collect()];
            let found = source(&table(&stamps), &clock(), &stamps, channels, &ALL).unwrap();
            near(found.rate.hz(), rate_hz, 1e-3 * rate_hz);
            prop_assert_eq!(found.channels[0].len(), next + 300);
            let is_gap = |n: usize| {
                let time = n as f64 / found.rate.hz();
                found.timing.gaps.iter().any(|gap| (gap.start_s..gap.start_s + gap.seconds).contains(&time))
            };
            for (n, x) in found.channels[0].iter().enumerate() {
                if places.binary_search(&n).is_ok() {
                    prop_assert!((x - tone(n as f64 / rate_hz)).abs() < 1e-9, "{}", n);
                } else if !is_gap(n) {
                    prop_assert!((x - tone(n as f64 / rate_hz)).abs() < 1e-2, "{}", n);
                }
            }
            let single = runs.iter().filter(|run| run.1 == 1).count();
            let few = single as f64 <= 0.01 * (next + 300) as f64;
            prop_assert_eq!(found.timing.lost, if few { single } else { 0 });
            prop_assert_eq!(found.timing.gaps.len(), runs.len() - found.timing.lost);
        }

        #[test]
        fn only_the_part_that_is_used_is_judged(start in 0usize..700, length in 100usize..300, back: bool) {
            let gap_s = if back { -3.0 } else { 0.5 };
            let after = |n: usize| if n >= 1000 { gap_s } else { 0.0 };
            let times: Vec<f64> = (0..2000).map(|n| n as f64 / 1000.0 + after(n)).collect();
            let cut = Cut { start_s: start as f64 / 1000.0, duration_s: length as f64 / 1000.0 };
            let found = of(&times, 1.0, &clock(), &cut).unwrap();
            prop_assert_eq!(found.timing, Timing { samples: length, ..Timing::default() });
            let expected: Vec<f64> = (start..start + length).map(|n| tone(n as f64 / 1000.0)).collect();
            prop_assert_eq!(&found.channels[0], &expected);
            prop_assert_eq!(of(&times, 1.0, &clock(), &ALL).is_err(), back);
        }

        #[test]
        fn even_samples_in_bunches_are_told_and_taken_as_even_on_request(
            size in 2usize..64, share in 0.01..0.4f64, factor in prop::sample::select(vec![1.0, 1e3, 1e6]),
        ) {
            // The last sample of a bunch is on time; the others are read just before it.
            let late = |n: usize| (size - 1 - n % size) as f64 * (1.0 - share);
            let times: Vec<f64> = (0..size * 200).map(|n| (n as f64 + late(n)) / 2000.0).collect();
            match of(&times, factor, &clock(), &ALL) {
                Ok(found) => prop_assert_eq!(found.timing.bunch, Some(size)),
                Err(fault) => {
                    let words = [format!("bunches of {size}"), "--even-times".into(), "at 2000 Hz".into()];
                    holds(&fault, &words.each_ref().map(String::as_str));
                }
            }
            let found = of(&times, factor, &Clock { is_even: true, ..clock() }, &ALL).unwrap();
            near(found.rate.hz(), 2000.0, 2.0);
            prop_assert_eq!(found.channels[0].len(), times.len());
            prop_assert_eq!(found.times_s, None);
        }

        #[test]
        fn of_a_motion_a_gap_and_a_step_back_are_named_with_their_line(
            at in 1usize..999, step_s in 1e-5..0.1f64, share in prop::sample::select(vec![-40.0, -1.0, 0.6, 30.0, 0.0]),
        ) {
            let mut times: Vec<f64> = (0..1000).map(|n| step_s * f64::from(n)).collect();
            let rate = |times: &[f64]| even_rate(&table(times), "time_s", times);
            prop_assert!((rate(&times).unwrap() * step_s - 1.0).abs() < 1e-6);
            // A step of zero is a line that repeats the previous time.
            let off = if share == 0.0 { -step_s } else { share * step_s };
            times[at..].iter_mut().for_each(|time| *time += off);
            if share == 0.0 {
                times[at] = times[at - 1];
            }
            let word = if share > 0.0 { "a gap" } else { "" };
            let message = rate(&times).unwrap_err();
            holds(&message, &[&format!("line {}:", at + 3), word]);
        }
    }

    #[test]
    fn gaps_whose_lengths_no_sum_holds_are_refused() {
        let gap = 2f64.powi(50);
        // Each gap counts 2⁶³ missing samples.
        let time = |n: usize| (n / 100) as f64 * gap + (n % 100) as f64 / 8192.0;
        let times: Vec<f64> = (0..500).map(time).collect();
        let fault = of(&times, 1.0, &clock(), &ALL).unwrap_err();
        holds(&fault, &["a gap of", "most of the part"]);
    }

    #[test]
    fn times_of_a_motion_with_too_few_digits_are_refused_as_such() {
        let times: Vec<f64> = (0..1000).map(|n| f64::from(n / 10) / 1000.0).collect();
        let fault = even_rate(&table(&times), "time_s", &times).unwrap_err();
        holds(&fault, &["too few digits", "--sample-rate"]);
    }

    #[test]
    fn times_that_tell_no_rate_are_refused_and_a_given_rate_counts_then() {
        for (times, word) in [
            (&[][..], "no samples"),
            (&[1.0], "one sample"),
            (&[0.0, 0.0, 0.0], "line 4"),
            (&[0.0, f64::NAN], "line 4"),
            (&[0.0, f64::INFINITY], "line 4"),
            (&[0.0, 0.001, 0.001, 0.002], "line 5"),
            (&[0.0, 0.001, 0.002, 0.001], "must rise"),
            (&[0.0, 0.001, 0.1, 0.101], "a gap of 0.099000 s"),
        ] {
            // All values differ, so that no row occurs twice.
            let channels = || vec![(0..times.len()).map(|n| n as f64).collect()];
            let seconds = Clock {
                unit: Some(TimeUnit::S),
                ..clock()
            };
            let fault = source(&table(times), &seconds, times, channels(), &ALL).unwrap_err();
            holds(&fault, &[word]);
            let given = Clock {
                rate: SampleRate::new(800.0, "").ok(),
                ..seconds
            };
            let found = source(&table(times), &given, times, channels(), &ALL).unwrap();
            assert_eq!((found.rate.hz(), found.channels), (800.0, channels()));
        }
    }

    #[test]
    fn a_unit_is_that_of_the_name_or_of_the_option_or_told() {
        let times: Vec<f64> = (0..3000).map(|n| 12.0 + f64::from(n) / 1600.0).collect();
        for unit in [TimeUnit::S, TimeUnit::Ms, TimeUnit::Us, TimeUnit::Ns] {
            let factor = unit.per_second();
            for (clock, guessed) in [
                (
                    Clock {
                        unit: Some(unit),
                        ..clock()
                    },
                    None,
                ),
                (
                    Clock {
                        rate: SampleRate::new(1550.0, "").ok(),
                        ..clock()
                    },
                    None,
                ),
                (clock(), Some(unit).filter(|unit| *unit != TimeUnit::S)),
            ] {
                let found = of(&times, factor, &clock, &ALL).unwrap();
                assert_eq!(found.rate.hz(), 1600.0);
                assert_eq!(found.timing.guessed_unit, guessed);
                assert_eq!(found.times_s, None, "{unit:?}");
            }
        }
        let wrong = Clock {
            unit: Some(TimeUnit::S),
            ..clock()
        };
        holds(
            &of(&times, 1e3, &wrong, &ALL).unwrap_err(),
            &["--time-unit", "--sample-rate"],
        );
    }
}
