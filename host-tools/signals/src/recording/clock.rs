//! The clock of a recording: when its samples were taken, as its times tell.
//!
//! Times are rarely those of an ideal clock. They have few digits or come late; they start again where a counter wraps
//! or a block begins; rows are swapped, repeated, lost, or written for other sensors. One estimate of the order, the
//! step and the missing samples accounts for all of that. [`Timing`] and the remarks tell what it found.
//!
//! Missing samples are filled in, so that the index of a sample determines its time. A single missing sample is
//! interpolated. Longer gaps are filled from their surroundings, and triage cuts them.

use core::f64::consts::FRAC_PI_2;
use std::ops::Range;

use stylus_support::csv_table::CsvTable;
use stylus_support::{Error, Result};

use super::defects::{Gap, Timing};
use super::joined::own_rows;
use super::order::Order;
use super::rate::{SampleRate, counts_before};
use super::step::{Clock, DIGITS, FEW_LOST, MOST_OF_BUNCH, Missing, bunch, resolution, slope};
use super::times::TimeUnit;
use super::trial::{Cut, Source};
use super::uneven::{Steps, mean_step};
use super::unit::Stated;

/// Largest deviation of a rate that was given from that of the times at which they still show gaps.
const NEAR_RATE: f64 = 0.2;

/// Facts about a file's times, in addition to the times themselves.
pub(super) struct TimeFacts<'a> {
    /// Name of the column of times.
    pub column: &'a str,
    /// Unit of the times, if it was given or is in the column's name.
    pub unit: Option<TimeUnit>,
    /// True if the samples are evenly spaced, regardless of the times.
    pub is_even: bool,
    /// The sample rate that was given. It has priority over the times, which then show only gaps.
    pub rate: Option<SampleRate>,
}

/// Returns the samples of `channels` within `cut`. `times` has one time for each row of `table` below its header.
///
/// # Errors
/// There are fewer than two times, one is not finite, many fall, or they give a rate that is not possible for a
/// recording; or, within the part, they come in bunches with gaps between them, or consist mostly of gaps. Where one
/// line is at fault, the error states it. With a given rate, such samples are evenly spaced at it instead.
pub(super) fn source(
    table: &CsvTable,
    told: &TimeFacts<'_>,
    times: Vec<f64>,
    mut channels: Vec<Vec<f64>>,
    cut: &Cut,
) -> Result<Source> {
    let layout = Stamps::of(table, told, times).and_then(|stamps| {
        if let Some(order) = &stamps.rows {
            for channel in &mut channels {
                *channel = order.iter().map(|&row| channel[row]).collect();
            }
        }
        stamps.layout(&channels, cut)
    });
    match (layout, told.rate) {
        (Err(_), Some(rate)) => {
            let remark = format!("its times are not used, because a rate was given: {} Hz", rate.hz());
            let source = even(rate, channels, cut);
            Ok(Source {
                remarks: vec![remark],
                ..source
            })
        }
        (layout, _) => Ok(layout?.laid_out(channels)),
    }
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

impl TimeFacts<'_> {
    /// Returns the unit of `times`, and true if no name or option states it and it is not seconds.
    fn unit_of(&self, times: &[f64]) -> (TimeUnit, bool) {
        if let Some(unit) = self.unit {
            return (unit, false);
        }
        // If a sensor's queue is read at once, the usual step is short or zero, and only the mean shows the rate.
        let (mean, usual) = (mean_step(times), Steps::of(times, 1).usual_s);
        let by_rate = |rate: SampleRate| TimeUnit::of_steps(mean, usual, Some(rate.hz()));
        if let Some(unit) = self.rate.and_then(by_rate) {
            return (unit, false);
        }
        let unit = TimeUnit::of_steps(mean, usual, None).unwrap_or(TimeUnit::S);
        (unit, unit != TimeUnit::S)
    }
}

/// How a file's rows become evenly spaced samples.
struct Layout {
    rate: SampleRate,
    /// Rows that are kept.
    rows: Vec<usize>,
    missing: Vec<Missing>,
    /// True if a missing sample has the value of the one before it.
    is_held: bool,
    /// Times of the rows, s, if they are uneven.
    times_s: Option<Vec<f64>>,
    timing: Timing,
    remarks: Vec<String>,
}

/// Times of a file in their unit, which do not fall.
struct Stamps<'a> {
    table: &'a CsvTable,
    told: &'a TimeFacts<'a>,
    times: Vec<f64>,
    unit: TimeUnit,
    is_guess: bool,
    /// The file's rows in the order of the times, if it is another.
    rows: Option<Vec<usize>>,
    remark: Option<String>,
}

impl<'a> Stamps<'a> {
    /// Returns the times in the order in which samples were taken.
    fn of(table: &'a CsvTable, told: &'a TimeFacts<'a>, times: Vec<f64>) -> Result<Self> {
        if times.len() < 2 {
            let problem = match times[..] {
                [] => "holds no samples",
                _ => "holds one sample, whose time tells no sample rate: record for longer",
            };
            return Err(Error::file(table.path(), problem));
        }
        // The header counts as a row, too.
        let error = |row: usize, problem| Err(Error::line(table.path(), table.line_of_row(row + 1), problem));
        if let Some(row) = times.iter().position(|time| !time.is_finite()) {
            return error(row, format!("{} is no number: remove the line", told.column));
        }
        let falls = || (1..times.len()).filter(|&row| times[row] < times[row - 1]);
        if let Some(row) = falls().next().filter(|_| 4 * falls().count() > times.len()) {
            let (column, time, before) = (told.column, times[row], times[row - 1]);
            let problem = format!(
                "{column} is {time} after {before}, and falls often: give --sample-rate if samples are in even steps"
            );
            return error(row, problem);
        }
        let Order { times, rows, remark } = Order::of(times);
        let (unit, is_guess) = told.unit_of(&times);
        Ok(Self {
            table,
            told,
            times,
            unit,
            is_guess,
            rows,
            remark,
        })
    }

    fn layout(&self, channels: &[Vec<f64>], cut: &Cut) -> Result<Layout> {
        let part = self.part(cut);
        let own = own_rows(&self.times, channels, part.clone());
        let mut rows = own.unwrap_or_else(|| part.clone().collect());
        let with_empty = rows.len();
        rows.retain(|&row| is_sampled(channels, row));
        let empty = with_empty - rows.len();
        let resolution = resolution(&self.times);
        // A row that occurs twice counts once, unless times have so few digits that several samples share one.
        if resolution < mean_step(&self.times) {
            rows.dedup_by(|row, before| {
                let is_same = |axis: &Vec<f64>| axis[*row] == axis[*before];
                self.times[*row] == self.times[*before] && channels.iter().all(is_same)
            });
        }
        let removed = part.len() - rows.len();
        if rows.len() < 2 {
            let problem = "has fewer than two samples in the part that is used: give another start_s or duration_s";
            return Err(Error::file(self.table.path(), problem));
        }
        let times: Vec<f64> = rows.iter().map(|&row| self.times[row]).collect();
        if times[0] >= times[times.len() - 1] {
            let problem = format!("{} is {} in all lines: give --sample-rate", self.told.column, times[0]);
            return Err(Error::file(self.table.path(), problem));
        }
        let are_changes = removed == 0 && are_changes(channels, &rows, &times);
        let bunch = bunch(&times).filter(|_| !are_changes);
        // Samples that share a time are known by their bunch alone.
        let shared = bunch.filter(|_| times.windows(2).any(|pair| pair[0] == pair[1]));
        let is_coarse = resolution > MOST_OF_BUNCH as f64 * mean_step(&times);
        if is_coarse && !are_changes {
            let problem = format!(
                "{} has so few digits that more than {MOST_OF_BUNCH} samples share a time: give --sample-rate, or \
                 write times with more digits",
                self.told.column
            );
            return Err(Error::file(self.table.path(), problem));
        }
        let clock = Clock::of(&times, shared.map_or(resolution, |(_, apart)| apart), are_changes);
        let step = if self.told.is_even && bunch.is_some() {
            slope(&times)
        } else {
            clock.step
        };
        let rate = self.rate_of(step);
        if self.told.is_even {
            let rate = self.told.rate.map_or(rate, Ok)?;
            return Ok(Layout::even(rate, channels, cut));
        }
        // Between bunches, missing samples cannot be told from the wait for the next bunch.
        if let Some((size, apart)) = bunch.filter(|_| shared.is_none() && !clock.missing.is_empty()) {
            return Err(Error::file(self.table.path(), self.bunch_fault(&times, size, apart)));
        }
        let rate = rate?;
        self.refuse_mostly_missing(&rows, &clock.missing, step, if are_changes { MOST_HELD } else { 1 })?;
        let mut remarks: Vec<String> = self.remark.iter().cloned().collect();
        remarks
            .extend(are_changes.then(|| "only changes were written, so values are held between its rows".to_owned()));
        remarks
            .extend(shared.map(|(size, _)| format!("bunches of {size} samples share a time, and are taken as even")));
        // Between samples that share a time, nothing could be interpolated.
        let is_even = clock.is_even || self.told.rate.is_some() || times.windows(2).any(|pair| pair[1] <= pair[0]);
        let times_s = (!is_even).then(|| times.iter().map(|t| self.seconds(*t)).collect());
        let refilled: usize = clock.missing.iter().map(|gap| gap.count).sum();
        let timing = Timing {
            guessed_unit: self.is_guess.then_some(self.unit),
            // A row without a sample is a loss if a sample is due there; between two samples it is another sensor's
            // row.
            joined_rows: removed - empty.min(refilled),
            bunch: bunch.filter(|_| !is_even).map(|(size, _)| size),
            ..Timing::default()
        };
        let layout = Layout {
            rate: self.given_or(rate, &mut remarks)?,
            rows,
            missing: clock.missing,
            is_held: are_changes,
            times_s,
            timing,
            remarks,
        };
        Ok(if are_changes { layout } else { layout.with_gaps_told() })
    }

    /// Returns the rate that was given, if it is near `rate`, the one of the times; otherwise `rate` itself.
    fn given_or(&self, rate: SampleRate, remarks: &mut Vec<String>) -> Result<SampleRate> {
        let Some(given) = self.told.rate else {
            return Ok(rate);
        };
        if (rate.hz() / given.hz() - 1.0).abs() > NEAR_RATE {
            return Err(Error::file(self.table.path(), "has times of another rate"));
        }
        remarks.extend(counts_before(given.hz(), "its times say", rate.hz()));
        Ok(given)
    }

    /// Returns the rows whose times are within `cut`.
    fn part(&self, cut: &Cut) -> Range<usize> {
        // Half a step is the rounding of [`Cut::frames`].
        let half = 0.5 * mean_step(&self.times);
        let until = |seconds: f64| {
            let least = self.times[0] + seconds * self.unit.per_second() - half;
            self.times.partition_point(|time| *time < least)
        };
        let first = until(cut.start_s);
        first..until(cut.start_s + cut.duration_s).max(first)
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
            self.told.column,
            self.unit.name()
        );
        let rate_hz = near_whole(self.unit.per_second() / step);
        SampleRate::new(rate_hz, &remedy).map_err(|fault| Error::file(self.table.path(), fault))
    }

    /// Refuses `rows` if more than `most` times as many samples are missing as are present.
    fn refuse_mostly_missing(&self, rows: &[usize], missing: &[Missing], step: f64, most: usize) -> Result<()> {
        let total = missing
            .iter()
            .fold(0, |total: usize, gap| total.saturating_add(gap.count));
        let Some(longest) = missing
            .iter()
            .max_by_key(|gap| gap.count)
            .filter(|_| total > most * rows.len())
        else {
            return Ok(());
        };
        let [before, time] = [0, 1].map(|next| self.times[rows[longest.after + next]]);
        let problem = format!(
            "{} is {time} after {before}: a gap of {:.6} {unit} where lines are {step:.6} {unit} apart, and gaps are \
             most of the part that is used: give start_s and duration_s of a part without them",
            self.told.column,
            time - before,
            unit = self.unit.name()
        );
        let row = rows[longest.after + 1];
        let row = self.rows.as_ref().map_or(row, |rows| rows[row]);
        // The header counts as a row, too.
        Err(Error::line(self.table.path(), self.table.line_of_row(row + 1), problem))
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
}

impl Layout {
    /// Returns the layout of evenly spaced samples at `rate`. Rows of `channels` without a sample are missing
    /// samples, unless most rows have none.
    fn even(rate: SampleRate, channels: &[Vec<f64>], cut: &Cut) -> Self {
        let rows = channels.first().map_or(0, Vec::len);
        let (first, end) = cut.frames(rate.hz());
        let part = first.min(rows)..end.clamp(first.min(rows), rows);
        let kept: Vec<usize> = part.clone().filter(|&row| is_sampled(channels, row)).collect();
        let are_few = 2 * kept.len() < part.len();
        let mut layout = Self {
            rate,
            rows: if are_few { part.collect() } else { kept },
            missing: Vec::new(),
            is_held: false,
            times_s: None,
            timing: Timing::default(),
            remarks: Vec::new(),
        };
        let gap = |(after, pair): (usize, &[usize])| Missing {
            after,
            count: pair[1] - pair[0] - 1,
        };
        let gaps = layout.rows.windows(2).enumerate().map(gap);
        layout.missing = gaps.filter(|gap| gap.count > 0).collect();
        layout.with_gaps_told()
    }

    /// Records the missing samples as findings: a few single ones by their number, the others as gaps.
    fn with_gaps_told(mut self) -> Self {
        let missing: usize = self.missing.iter().map(|gap| gap.count).sum();
        if missing == 0 {
            return self;
        }
        let all = self.rows.len() + missing;
        let single = self.missing.iter().filter(|gap| gap.count == 1).count();
        let are_few = single as f64 <= FEW_LOST * all as f64;
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
        self.timing.samples = all;
        self
    }

    /// Arranges the rows of `channels` into evenly spaced samples.
    fn laid_out(self, mut channels: Vec<Vec<f64>>) -> Source {
        for channel in &mut channels {
            let kept: Vec<f64> = self.rows.iter().map(|&row| channel[row]).collect();
            *channel = match (self.missing.is_empty(), self.is_held) {
                (true, _) => kept,
                (false, true) => spread(&kept, &self.missing, |gap, _| kept[gap.after]),
                (false, false) => filled(&kept, &self.missing),
            };
        }
        Source {
            rate: self.rate,
            first_frame: self.rows.first().copied().unwrap_or(0),
            times_s: self.times_s.map(|times| {
                spread(&times, &self.missing, |gap, n| {
                    let (before, behind) = (times[gap.after], times[gap.after + 1]);
                    before + (behind - before) * n as f64 / (gap.count + 1) as f64
                })
            }),
            channels,
            truncation: None,
            stated: Stated::default(),
            unscaled: None,
            remarks: self.remarks,
            timing: self.timing,
        }
    }
}

/// Largest mean number of samples for which a value is held where only changes were written.
const MOST_HELD: usize = 16;

/// Least fraction of changes by the least change, in samples so coarse that many would repeat the one before.
const LEAST_CHANGES: f64 = 0.2;

/// Returns true if rows were written only for changes: samples are coarse, and none repeats the one before it.
fn are_changes(channels: &[Vec<f64>], rows: &[usize], times: &[f64]) -> bool {
    let steps = || times.windows(2).map(|pair| pair[1] - pair[0]);
    let shortest = steps().fold(f64::INFINITY, f64::min);
    let longer = steps().filter(|step| *step > 1.5 * shortest).count();
    let change = |pair: &[usize]| -> f64 { channels.iter().map(|axis| (axis[pair[1]] - axis[pair[0]]).abs()).sum() };
    let changes = || rows.windows(2).map(change);
    let least = changes().fold(f64::INFINITY, f64::min);
    let alike = changes().filter(|change| *change < 1.5 * least).count();
    let least_alike = LEAST_CHANGES * rows.len() as f64;
    rows.len() > DIGITS && least > 0.0 && alike as f64 >= least_alike && 2.0 * longer as f64 >= least_alike
}

/// Returns `samples` with the missing samples filled in. A single one is interpolated by the polynomial through the six
/// samples around it. A longer gap is filled with the reversed samples before and after it, with a crossfade. Then its
/// level and spectrum are those of its surroundings, so that no other defect is found there.
fn filled(samples: &[f64], missing: &[Missing]) -> Vec<f64> {
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    let at = |place: usize| samples[place.min(samples.len() - 1)] - mean;
    spread(samples, missing, |gap, n| {
        let around = (gap.after + 1)
            .checked_sub(3)
            .and_then(|from| samples.get(from..from + 6));
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

/// Rounds `rate_hz` to a whole number if it is close to one, because times are often printed with few digits.
fn near_whole(rate_hz: f64) -> f64 {
    let whole = rate_hz.round();
    if (rate_hz / whole - 1.0).abs() < 1e-3 {
        whole
    } else {
        rate_hz
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

    const ALL: Cut = Cut::WHOLE;

    fn table(times: &[f64]) -> CsvTable {
        let rows = times.iter().map(|time| format!("{time},1\n"));
        let text = format!("# x\ntime_s,x\n{}", rows.collect::<String>());
        CsvTable::of(Path::new("a.csv"), text).unwrap()
    }

    fn told() -> TimeFacts<'static> {
        TimeFacts {
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
    fn of(times: &[f64], factor: f64, told: &TimeFacts<'_>, cut: &Cut) -> Result<Source> {
        let written: Vec<f64> = times.iter().map(|time| time * factor).collect();
        let channels = vec![times.iter().map(|time| tone(*time)).collect()];
        source(&table(&written), told, written, channels, cut)
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
            let found = source(&table(&stamps), &told(), stamps.clone(), channels, &ALL).unwrap();
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
            let found = of(&times, 1.0, &told(), &cut).unwrap();
            prop_assert_eq!(found.timing, Timing::default());
            let expected: Vec<f64> = (start..start + length).map(|n| tone(n as f64 / 1000.0)).collect();
            prop_assert_eq!(&found.channels[0], &expected);
            let all = of(&times, 1.0, &told(), &ALL).unwrap();
            prop_assert_eq!((all.remarks.len(), all.timing.gaps.len()), if back { (1, 0) } else { (0, 1) });
        }

        #[test]
        fn even_samples_in_bunches_are_told_and_taken_as_even_on_request(
            size in 2usize..64, share in 0.01..0.4f64, factor in prop::sample::select(vec![1.0, 1e3, 1e6]),
        ) {
            // The last sample of a bunch is on time; the others are read just before it.
            let late = |n: usize| (size - 1 - n % size) as f64 * (1.0 - share);
            let times: Vec<f64> = (0..size * 200).map(|n| (n as f64 + late(n)) / 2000.0).collect();
            match of(&times, factor, &told(), &ALL) {
                Ok(found) => prop_assert_eq!(found.timing.bunch, Some(size)),
                Err(fault) => {
                    let words = [format!("bunches of {size}"), "--even-times".into(), "at 2000 Hz".into()];
                    holds(&fault, &words.each_ref().map(String::as_str));
                }
            }
            let found = of(&times, factor, &TimeFacts { is_even: true, ..told() }, &ALL).unwrap();
            near(found.rate.hz(), 2000.0, 2.0);
            prop_assert_eq!(found.channels[0].len(), times.len());
            prop_assert_eq!(found.times_s, None);
        }

        /// Times of few digits, with single losses; packets of rows that are swapped.
        #[test]
        fn samples_have_their_places_whatever_digits_and_order_their_times_have(
            rate_hz in prop::sample::select(vec![400.0, 833.0, 952.0, 1000.0, 1344.0, 1660.0, 2000.0, 3200.0]),
            digits in 3usize..6, lost in prop::collection::vec(100usize..3900, 0..6),
            packets in prop::collection::vec(2usize..180, 0..5),
        ) {
            let places: Vec<usize> = (0..4000).filter(|place| !lost.contains(place)).collect();
            let floor = |time: f64| (time * 10f64.powi(digits as i32)).floor() / 10f64.powi(digits as i32);
            let mut rows: Vec<(f64, f64)> = (places.iter())
                .map(|&place| (floor(5.0 + place as f64 / rate_hz), tone(place as f64 / rate_hz)))
                .collect();
            for at in packets {
                rows[20 * at..20 * at + 40].rotate_left(20);
            }
            let (times, channel): (Vec<f64>, Vec<f64>) = rows.into_iter().unzip();
            let found = source(&table(&times), &told(), times.clone(), vec![channel.clone()], &ALL).unwrap();
            near(found.rate.hz(), rate_hz, 2e-3 * rate_hz);
            let missing = found.channels[0].len() - channel.len();
            let single: std::collections::BTreeSet<usize> = lost.into_iter().collect();
            // A loss that is shorter than the digits is not always seen.
            let is_seen = rate_hz < 2000.0 || digits > 3;
            prop_assert!(missing == single.len() || !is_seen && missing < single.len(), "{} {}", missing, single.len());
            let is_even = TimeFacts { is_even: true, ..told() };
            let even = source(&table(&times), &is_even, times.clone(), vec![channel], &ALL);
            near(even.unwrap().rate.hz(), rate_hz, 2e-3 * rate_hz);
        }
    }

    #[test]
    fn gaps_whose_lengths_no_sum_holds_are_refused() {
        let gap = 2f64.powi(30);
        // Each gap counts 2⁴³ missing samples.
        let time = |n: usize| (n / 100) as f64 * gap + (n % 100) as f64 / 8192.0;
        let times: Vec<f64> = (0..500).map(time).collect();
        let fault = of(&times, 1.0, &told(), &ALL).unwrap_err();
        holds(&fault, &["a gap of", "most of the part"]);
    }

    #[test]
    fn values_are_held_where_only_changes_were_written() {
        let coarse: Vec<f64> = (0..4000).map(|n| (3.0 * tone(f64::from(n) / 1000.0)).round()).collect();
        let kept: Vec<usize> = (0..4000).filter(|&n| n == 0 || coarse[n] != coarse[n - 1]).collect();
        let times: Vec<f64> = kept.iter().map(|&n| n as f64 / 1000.0).collect();
        let channel = kept.iter().map(|&n| coarse[n]).collect();
        let found = source(&table(&times), &told(), times, vec![channel], &ALL).unwrap();
        assert_eq!(
            (found.rate.hz(), &found.channels[0][..]),
            (1000.0, &coarse[..=kept[kept.len() - 1]])
        );
        holds(&found.remarks.concat(), &["only changes"]);
    }

    #[test]
    fn times_that_tell_no_rate_are_refused_and_a_given_rate_counts_then() {
        for (times, word) in [
            (&[][..], "no samples"),
            (&[1.0], "one sample"),
            (&[0.0, 0.0, 0.0], "is 0 in all lines"),
            (&[0.0, f64::NAN], "line 4"),
            (&[0.0, f64::INFINITY], "line 4"),
            (&[0.0, 0.002, 0.001, 0.003, 0.002], "line 5"),
            (&[0.0, 0.001, 0.1, 0.101], "a gap of 0.099000 s"),
            (&[&[3.0; 500][..], &[4.0; 500]].concat()[..], "so few digits"),
        ] {
            // All values differ, so that no row occurs twice.
            let channels = || vec![(0..times.len()).map(|n| n as f64).collect()];
            let seconds = TimeFacts {
                unit: Some(TimeUnit::S),
                ..told()
            };
            let fault = source(&table(times), &seconds, times.to_vec(), channels(), &ALL).unwrap_err();
            holds(&fault, &[word]);
            let given = TimeFacts {
                rate: SampleRate::new(800.0, "").ok(),
                ..seconds
            };
            let found = source(&table(times), &given, times.to_vec(), channels(), &ALL).unwrap();
            holds(&found.remarks.concat(), &["800 Hz"]);
            assert_eq!((found.rate.hz(), found.channels), (800.0, channels()));
        }
    }

    #[test]
    fn a_unit_is_that_of_the_name_or_of_the_option_or_told() {
        let times: Vec<f64> = (0..3000).map(|n| 12.0 + f64::from(n) / 1600.0).collect();
        for unit in [TimeUnit::S, TimeUnit::Ms, TimeUnit::Us, TimeUnit::Ns] {
            let factor = unit.per_second();
            for (told, rate_hz, guessed) in [
                (
                    TimeFacts {
                        unit: Some(unit),
                        ..told()
                    },
                    1600.0,
                    None,
                ),
                (
                    TimeFacts {
                        rate: SampleRate::new(1550.0, "").ok(),
                        ..told()
                    },
                    1550.0,
                    None,
                ),
                (told(), 1600.0, Some(unit).filter(|unit| *unit != TimeUnit::S)),
            ] {
                let found = of(&times, factor, &told, &ALL).unwrap();
                assert_eq!(found.rate.hz(), rate_hz);
                assert_eq!(found.remarks.is_empty(), told.rate.is_none());
                assert_eq!(found.timing.guessed_unit, guessed);
                assert_eq!(found.times_s, None, "{unit:?}");
            }
        }
        let wrong = TimeFacts {
            unit: Some(TimeUnit::S),
            ..told()
        };
        holds(
            &of(&times, 1e3, &wrong, &ALL).unwrap_err(),
            &["--time-unit", "--sample-rate"],
        );
    }
}
