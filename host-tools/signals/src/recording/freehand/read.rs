//! CSV files of a free hand's recording with its motion.

use std::io::Read;
use std::path::Path;

use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, Header, Row, comment};
use stylus_support::number::counted;
use stylus_support::number::{MAX_FORCE_N, MAX_SPEED_MM_S};
use stylus_support::{Error, Result};

use super::positions::{self, PositionColumn};
use crate::recording::axes::LeftOut;
use crate::recording::clock::{self, TimeFacts};
use crate::recording::csv_file::{counts, is_no_value};
use crate::recording::rate::length_fault;
use crate::recording::times::TimeColumn;
use crate::recording::uneven::evened;
use crate::recording::{Cut, MAX_CHANNELS, MAX_FRAMES, SampleRate, Source, Timing};
use crate::recording::{lvm, unit};

/// Names of the columns other than accelerations.
const TIME: &str = "time_s";
const SPEED: &str = "speed_mm_s";
const FORCE: &str = "force_n";

/// Largest magnitude of an acceleration that the stylus can play. A larger value is an outlier, and so are motions that
/// no hand can perform.
const MAX_ACCELERATION_M_S2: f64 = 2048.0;

/// Largest fraction of samples with an outlier; a file with more is refused.
const MAX_OUTLIER_SHARE: f64 = 0.1;

/// A recording with its motion, evenly sampled.
#[derive(Clone, Debug, PartialEq)]
pub struct Freehand {
    /// Sample rate, Hz.
    pub rate_hz: f64,
    /// One to three axes of equal length, m/s².
    pub axes: Vec<Vec<f64>>,
    /// Magnitude of the tangential speed, mm/s.
    pub speed_mm_s: Vec<f64>,
    /// True for each sample whose speed is negative in the file, which means the other direction.
    pub is_backward: Vec<bool>,
    /// Normal force, N; a value below zero means no contact.
    pub force_n: Vec<f64>,
    /// True for each sample with an outlier in any column.
    pub is_outlier: Vec<bool>,
    /// The first outlier with its line, in words.
    pub outlier: Option<String>,
    /// True if the file states that it is simulated.
    pub is_simulated: bool,
    /// True if neither the file nor the caller states what a count is in m/s².
    pub is_unscaled: bool,
    /// Conversions of units, and doubts about them, one line each.
    pub remarks: Vec<String>,
}

impl Freehand {
    /// Returns notes on units and outliers of the recording in the file at `path`, one line each.
    pub fn notes(&self, path: &Path) -> Vec<String> {
        let path = path.display();
        let remarks = self.remarks.iter().map(|remark| format!("{path}: {remark}"));
        let cut = self.outlier.iter().map(|first| {
            let count = self.is_outlier.iter().filter(|bad| **bad).count();
            let count = counted(count, "sample");
            format!("{path}, {first}, which is out of range; {count} cut out")
        });
        remarks.chain(cut).collect()
    }

    /// Appends a row to `channels`, one for each of `columns`; an outlier becomes 0, and a motion that is not written
    /// NaN. `names` are the names of the row's columns.
    fn push(&mut self, row: &Row<'_, '_>, columns: &[Column], names: &[&str], channels: &mut [Vec<f64>]) -> Result<()> {
        let mut bad = false;
        for (column, channel) in columns.iter().zip(&mut *channels) {
            let index = column.index;
            if column.is_motion && is_no_value(row.text(index)) {
                channel.push(f64::NAN);
                continue;
            }
            let value = column.scale * row.number(index)?;
            let is_good = value.is_finite() && value.abs() <= column.limit;
            if !is_good {
                self.outlier
                    .get_or_insert_with(|| format!("line {}: {} is {value}", row.line, names[index]));
            }
            bad |= !is_good;
            // Segments and strokes leave out a block with an outlier, so any finite number will do for them.
            channel.push(if is_good { value } else { 0.0 });
        }
        channels[columns.len()].push(f64::from(u8::from(bad)));
        Ok(())
    }

    /// Leaves out the gaps of `timing`, and says what is missing.
    fn leave_out(&mut self, timing: &Timing) {
        let length = self.is_outlier.len();
        for gap in &timing.gaps {
            let at = |time_s: f64| ((time_s * self.rate_hz) as usize).min(length);
            self.is_outlier[at(gap.start_s)..at(gap.start_s + gap.seconds)].fill(true);
        }
        let (gaps, lost, all) = (timing.gaps.len(), timing.lost, timing.samples);
        if lost > 0 {
            let lost = counted(lost, "sample");
            self.remarks
                .push(format!("{lost} of {all} missing one by one, interpolated"));
        }
        if gaps > 0 {
            let gaps = counted(gaps, "gap");
            self.remarks.push(format!("{gaps} in the times, left out"));
        }
    }

    /// Adds the speeds of all rows, mm/s, as positions give them. One that no hand can perform is an outlier.
    fn follow(&mut self, table: &CsvTable, speeds_mm_s: &[f64]) {
        for (index, &value) in speeds_mm_s.iter().enumerate() {
            let is_bad = value.abs() > MAX_SPEED_MM_S;
            if is_bad {
                let line = table.line_of_row(index + 1);
                self.outlier
                    .get_or_insert_with(|| format!("line {line}: the speed of its positions is {value}"));
            }
            self.is_outlier[index] |= is_bad;
            self.speed_mm_s.push(if is_bad { 0.0 } else { value.abs() });
            self.is_backward.push(value < 0.0);
        }
    }
}

/// Returns true if a comment at the top of a CSV file's `text` begins with SIMULATED.
fn says_simulated(text: &str) -> bool {
    let mut comments = text.lines().map_while(comment);
    comments.any(|comment| comment.trim_start().starts_with("SIMULATED"))
}

/// Length of the beginning of a file in which a comment may state that it is SIMULATED, bytes.
const TOP_BYTES: u64 = 4096;

/// Returns true if the recording at `path` is text that states at its beginning that it is SIMULATED.
pub fn is_simulated(path: &Path) -> Result<bool> {
    let mut top = Vec::new();
    let read = (Format::Wave.open(path)?).take(TOP_BYTES).read_to_end(&mut top);
    read.map_err(Error::io("read", path))?;
    Ok(says_simulated(&String::from_utf8_lossy(&top)))
}

/// Reads a CSV file with the columns `speed_mm_s` and `force_n`, and one to three columns of accelerations, in units of
/// `scale_m_s2`. In place of the speed, there may be positions, such as `x_mm` and `y_mm`. If the scale is not given,
/// they are in the unit of the header, or m/s². If accelerations are named, other columns are left out. Rows without a
/// motion, between rows that have one, are interpolated.
///
/// A column of times, such as `time_s` or `time_ms`, is necessary unless `rate_hz` is given. Comments begin with `#`; a
/// comment at the top that begins with SIMULATED marks the file as simulated.
///
/// # Errors
/// The file cannot be read or lacks one of these columns, a field is not a number, the times tell no rate, the rate is
/// not possible for a recording, no force is above zero, or there are too many rows or outliers.
pub fn read(path: &Path, rate_hz: Option<f64>, scale_m_s2: Option<f64>) -> Result<Freehand> {
    // Only regular files are accepted, because a recording is read again to determine its kind.
    Format::Strokes.open(path)?;
    if lvm::is_lvm(path)? {
        let problem = "is a LabVIEW file, and a free hand's recording is CSV: export it as .csv";
        return Err(Error::file(path, problem));
    }
    let table = CsvTable::read(path, Format::Strokes)?;
    let header = table.header()?;
    let names: Vec<&str> = header.names().collect();
    let columns = Columns::of(&header)?;
    let axes = &columns.axes;
    let of_axes: Vec<String> = axes.iter().map(|&index| names[index].to_owned()).collect();
    let stated = unit::stated(&of_axes, &table.comments()?);
    let scales_m_s2 = stated.scales_for(scale_m_s2, axes.len());
    let remarks = columns
        .left_out
        .remarks
        .iter()
        .cloned()
        .chain(stated.conversion(scale_m_s2));
    let mut recording = Freehand {
        rate_hz: 0.0,
        axes: Vec::new(),
        speed_mm_s: Vec::new(),
        force_n: Vec::new(),
        is_outlier: Vec::new(),
        outlier: None,
        is_backward: Vec::new(),
        is_simulated: is_simulated(path)?,
        is_unscaled: false,
        remarks: remarks.chain(stated.doubt(scale_m_s2)).collect(),
    };
    let all = columns.all(&scales_m_s2);
    let (mut times, mut channels) = (Vec::new(), vec![Vec::new(); all.len() + 1]);
    let mut rows = table.rows_below_header()?;
    while let Some(row) = rows.next_row()? {
        if let Some(time) = &columns.time {
            times.push(row.number(time.index)?);
        }
        recording.push(&row, &all, &names, &mut channels)?;
        if channels[0].len() > MAX_FRAMES {
            let problem = format!("more than {MAX_FRAMES} rows: cut the file");
            return Err(row.error(problem));
        }
    }
    if channels[0].is_empty() {
        return Err(Error::file(path, "holds no samples"));
    }
    let mut is_sparse = false;
    for (_, channel) in all.iter().zip(&mut channels).filter(|(column, _)| column.is_motion) {
        is_sparse |= bridged(channel);
    }
    if is_sparse {
        recording
            .remarks
            .push("rows without a motion have that between the rows around them".to_owned());
    }
    let source = source(&table, columns.time.as_ref(), times, rate_hz, channels)?;
    recording.rate_hz = source.rate.hz().round();
    recording.remarks.extend(source.remarks);
    let has_scale = scale_m_s2.is_some() || stated.scales_m_s2.is_some();
    recording.is_unscaled = !has_scale && counts(&source.channels[..axes.len()]).or(stated.counts()).is_some();
    if recording.is_unscaled {
        let text = "its samples have no unit, and no scale tells the acceleration of a count: 1 m/s² is taken; give \
                    --scale, such as g/256";
        recording.remarks.push(text.to_owned());
    }
    let channels = match &source.times_s {
        Some(times) => evened(&source.channels, times, recording.rate_hz),
        None => source.channels,
    };
    let mut channels = channels.into_iter();
    recording.axes = channels.by_ref().take(axes.len()).collect();
    recording.force_n = channels.next().unwrap_or_default();
    let motion: Vec<Vec<f64>> = channels.by_ref().take(all.len() - axes.len() - 1).collect();
    recording.is_outlier = channels.flatten().map(|share| share.abs() > 0.01).collect();
    refuse_no_press(path, &recording.force_n)?;
    if columns.speed.is_none() {
        let speeds_mm_s = positions::speed_mm_s(&motion, recording.rate_hz);
        recording.follow(&table, &speeds_mm_s);
    } else {
        recording.is_backward = motion[0].iter().map(|speed| *speed < 0.0).collect();
        recording.speed_mm_s = motion[0].iter().map(|speed| speed.abs().min(MAX_SPEED_MM_S)).collect();
    }
    refuse_too_many_outliers(path, &recording)?;
    recording.leave_out(&source.timing);
    let late = delay_s(&recording).map(|delay_s| {
        format!(
            "its motion comes {delay_s:.2} s after the accelerations that it makes: shift the motion's columns, or \
             start both loggers by one clock"
        )
    });
    recording.remarks.extend(late);
    Ok(recording)
}

/// Returns the rows of `channels` as evenly spaced samples, by their times or the given rate.
fn source(
    table: &CsvTable,
    time: Option<&TimeColumn>,
    times: Vec<f64>,
    given_hz: Option<f64>,
    channels: Vec<Vec<f64>>,
) -> Result<Source> {
    let path = table.path();
    let rate = given_hz
        .map(|rate_hz| SampleRate::new(rate_hz, "give another --sample-rate"))
        .transpose()
        .map_err(|fault| Error::file(path, fault))?;
    let source = match (time, rate) {
        (Some(time), rate) => {
            let told = TimeFacts {
                column: &time.name,
                unit: time.unit,
                is_even: false,
                rate,
            };
            clock::source(table, &told, times, channels, &Cut::WHOLE)?
        }
        (None, Some(rate)) => clock::even(rate, channels, &Cut::WHOLE),
        (None, None) => {
            let problem = format!("has no sample rate: add a column '{TIME}', or give --sample-rate");
            return Err(Error::file(path, problem));
        }
    };
    match length_fault(source.channels[0].len() as f64, MAX_CHANNELS) {
        Some(fault) => Err(Error::file(path, fault)),
        None => Ok(source),
    }
}

/// Fills values that are not there by a line between those around them, and returns whether there were any.
fn bridged(channel: &mut [f64]) -> bool {
    let known: Vec<usize> = (0..channel.len()).filter(|&row| !channel[row].is_nan()).collect();
    if known.is_empty() {
        channel.fill(0.0);
    }
    if known.len() == channel.len() || known.is_empty() {
        return false;
    }
    for row in 0..channel.len() {
        let next = known.partition_point(|&place| place < row);
        let [before, after] = [next.saturating_sub(1), next].map(|place| known[place.min(known.len() - 1)]);
        let share = (row.max(before) - before) as f64 / (after - before).max(1) as f64;
        let (from, to) = (channel[before], channel[after]);
        if channel[row].is_nan() {
            channel[row] = from + share.min(1.0) * (to - from);
        }
    }
    true
}

/// Refuses forces that press with the other sign.
fn refuse_no_press(path: &Path, force_n: &[f64]) -> Result<()> {
    let largest = force_n
        .iter()
        .fold(f64::NEG_INFINITY, |largest: f64, force| largest.max(*force));
    if largest > 0.0 || force_n.iter().all(|force| *force == 0.0) {
        return Ok(());
    }
    let problem = format!("no {FORCE} is above zero, and pressing is positive: change the sign of the column");
    Err(Error::file(path, problem))
}

/// Length of a block whose level is compared with its speed, s; longest delay that is sought, and shortest that is
/// told, in blocks.
const DELAY_BLOCK_S: f64 = 0.02;
const DELAYS: (isize, usize) = (25, 5);

/// Least correlation of levels with speeds and forces, and least gain of it, at a delay that is told.
const DELAYED: (f64, f64) = (0.6, 0.1);

/// Returns by how much the motion comes after the level of the accelerations, s, if it clearly does. A texture's level
/// follows its speed and force at once.
fn delay_s(recording: &Freehand) -> Option<f64> {
    let block = (DELAY_BLOCK_S * recording.rate_hz) as usize;
    let power = |n: usize| {
        recording
            .axes
            .iter()
            .map(|axis| (axis[n] - axis[n - 1]).powi(2))
            .sum::<f64>()
    };
    let blocks = (recording.speed_mm_s.len().max(1) - 1) / block.max(1);
    let sums = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let of_block =
            |number: usize| (number * block + 1..=(number + 1) * block).map(value).sum::<f64>() / block as f64;
        (0..blocks).map(of_block).collect()
    };
    let levels: Vec<f64> = sums(&power).iter().map(|power| (power + 1e-9).ln()).collect();
    let logarithms = |values: &[f64], least: f64| -> Vec<f64> {
        sums(&|n| values[n].max(0.0))
            .into_iter()
            .map(|mean| (mean + least).ln())
            .collect()
    };
    let motion = [
        logarithms(&recording.speed_mm_s, 1.0),
        logarithms(&recording.force_n, 0.01),
    ];
    let (longest, least) = DELAYS;
    let margin = longest.unsigned_abs();
    let middle = levels.get(margin..levels.len().checked_sub(margin)?)?;
    let alike = |delay: isize| {
        let begin = margin.checked_add_signed(delay)?;
        let [speeds, forces] = [motion[0].get(begin..)?, motion[1].get(begin..)?];
        Some((delay, explained(middle, speeds, forces)))
    };
    let (delay, best) = (-longest..=longest)
        .filter_map(alike)
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let is_clear = best > DELAYED.0 && best > alike(0)?.1 + DELAYED.1 && delay.unsigned_abs() >= least;
    is_clear.then_some(delay as f64 * DELAY_BLOCK_S)
}

/// Returns the multiple correlation of `levels` with as many of `speeds` and `forces`, because a level that a force
/// moves too has another phase than the speed.
fn explained(levels: &[f64], speeds: &[f64], forces: &[f64]) -> f64 {
    let of_speed = correlation(levels, speeds);
    let (of_force, of_both) = (
        correlation(levels, forces),
        correlation(&speeds[..levels.len()], forces),
    );
    let square = of_speed * of_speed + of_force * of_force - 2.0 * of_speed * of_force * of_both;
    let explained = (square / (1.0 - of_both * of_both)).sqrt();
    // A force that stands says nothing.
    if explained.is_finite() { explained } else { of_speed }
}

/// Returns the correlation coefficient of `values` with as many of `others`.
fn correlation(values: &[f64], others: &[f64]) -> f64 {
    let count = values.len() as f64;
    let sum = |product: fn(f64, f64) -> f64| -> f64 { values.iter().zip(others).map(|(x, y)| product(*x, *y)).sum() };
    let (x, y) = (sum(|x, _| x) / count, sum(|_, y| y) / count);
    let spread = |square: f64, mean: f64| square / count - mean * mean;
    (sum(|x, y| x * y) / count - x * y) / (spread(sum(|x, _| x * x), x) * spread(sum(|_, y| y * y), y)).sqrt()
}

fn refuse_too_many_outliers(path: &Path, recording: &Freehand) -> Result<()> {
    let count = recording.is_outlier.iter().filter(|bad| **bad).count();
    let most = MAX_OUTLIER_SHARE * recording.is_outlier.len() as f64;
    if count as f64 > most
        && let Some(first) = &recording.outlier
    {
        let all = recording.is_outlier.len();
        let problem = format!("{count} of {all} samples have impossible values ({first}): check its columns and units");
        return Err(Error::file(path, problem));
    }
    Ok(())
}

/// A column of samples or of the motion.
struct Column {
    index: usize,
    /// Factor to its unit here.
    scale: f64,
    /// Largest magnitude that is no outlier.
    limit: f64,
    is_motion: bool,
}

/// Indices of a file's columns.
struct Columns {
    time: Option<TimeColumn>,
    speed: Option<usize>,
    /// In place of a speed.
    positions: Vec<PositionColumn>,
    force: usize,
    axes: Vec<usize>,
    left_out: LeftOut,
}

impl Columns {
    fn of(header: &Header<'_>) -> Result<Self> {
        let expected = format!("a free hand's recording needs {SPEED}, or positions such as x_mm, and {FORCE}");
        let positions = positions::columns(header);
        let speed = match header.column(SPEED)? {
            None if (1..=MAX_CHANNELS).contains(&positions.len()) => None,
            _ => Some(header.needed(SPEED, &expected)?),
        };
        let force = header.needed(FORCE, &expected)?;
        // Checks that there is only one column of this name.
        header.exact_column(TIME)?;
        let names = header.names().enumerate();
        let times: Vec<TimeColumn> = (names.filter_map(|(index, name)| TimeColumn::named(index, name))).collect();
        let is_time = |index: &usize| TimeColumn::of(&times, *index).is_some();
        let samples = header
            .names()
            .enumerate()
            .filter(|(index, _)| Some(*index) != speed && *index != force && !is_time(index));
        let is_position = |index: usize| speed.is_none() && positions.iter().any(|position| position.index == index);
        let samples: Vec<(usize, &str)> = samples.filter(|(index, _)| !is_position(*index)).collect();
        let left_out = LeftOut::of(&samples);
        let axes: Vec<usize> = samples
            .iter()
            .map(|(index, _)| *index)
            .filter(|&index| !left_out.contains(index))
            .collect();
        let best = TimeColumn::best(&times).map(|time| time.index);
        let time = times.into_iter().find(|time| Some(time.index) == best);
        if axes.is_empty() || axes.len() > MAX_CHANNELS {
            return Err(header.error(format!(
                "{} columns of accelerations beside {SPEED}, {FORCE} and {TIME}: give 1 to {MAX_CHANNELS}",
                axes.len()
            )));
        }
        Ok(Self {
            time,
            speed,
            positions,
            force,
            axes,
            left_out,
        })
    }

    /// Returns the axes, in m/s², the force, and the speed or the positions.
    fn all(&self, scales_m_s2: &[f64]) -> Vec<Column> {
        let column = |is_motion| {
            move |(index, scale, limit): (usize, f64, f64)| Column {
                index,
                scale,
                limit,
                is_motion,
            }
        };
        let axes = self
            .axes
            .iter()
            .zip(scales_m_s2)
            .map(|(&index, &scale)| (index, scale, MAX_ACCELERATION_M_S2));
        let speed = self.speed.map(|index| (index, 1.0, MAX_SPEED_MM_S));
        let positions = self
            .positions
            .iter()
            .filter(|_| speed.is_none())
            .map(|position| (position.index, position.unit_mm, f64::MAX));
        let motion = [(self.force, 1.0, MAX_FORCE_N)]
            .into_iter()
            .chain(speed)
            .chain(positions);
        axes.map(column(false)).chain(motion.map(column(true))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{holds, near, new_file};

    #[test]
    fn times_in_any_unit_give_the_same_recording() {
        let (_folder, path) = new_file("a.csv");
        let read_as = |header: &str, factor: u32| {
            let rows = (0..500).map(|n| format!("{},{},100,1\n", factor * n, n % 7));
            let text = format!("{header},x,speed_mm_s,force_n\n{}", rows.collect::<String>());
            std::fs::write(&path, text).unwrap();
            read(&path, None, None).unwrap()
        };
        let in_ms = read_as("time_ms", 1);
        assert_eq!((in_ms.rate_hz, in_ms.axes.len()), (1000.0, 1));
        for (header, factor) in [("t [us]", 1000), ("timestamp_ns", 1_000_000)] {
            assert_eq!(read_as(header, factor), in_ms);
        }
    }

    #[test]
    fn positions_take_the_place_of_a_speed() {
        let (_folder, path) = new_file("a.csv");
        // 90 mm/s along x and 120 mm/s along y.
        let row = |n| {
            let s = f64::from(n) / 1000.0;
            format!("{s},{},{},1,{},1\n", 90.0 * s, 0.12 * s, n % 7)
        };
        let rows: String = (0..2000).map(row).collect();
        std::fs::write(
            &path,
            format!("Time (s),Pos X (mm),y_m,Normal Force (N),ax,gyro\n{rows}"),
        )
        .unwrap();
        let of_positions = read(&path, None, None).unwrap();
        assert!(of_positions.speed_mm_s.iter().all(|speed| (speed - 150.0).abs() < 1e-6));
        assert_eq!((of_positions.axes.len(), of_positions.outlier), (1, None));
        // A tracker that jumps by 100 mm for one sample.
        let rows = (0..2000).map(|n| {
            let mm = if n == 1000 { 200.0 } else { 0.1 * f64::from(n) };
            format!("{n},{mm},1,{}\n", n % 7)
        });
        let jump = format!("time_ms,position_mm,force_n,ax\n{}", rows.collect::<String>());
        std::fs::write(&path, jump).unwrap();
        let jumped = read(&path, None, None).unwrap();
        let bad = jumped.is_outlier.iter().filter(|bad| **bad).count();
        assert!((1..40).contains(&bad), "{bad}");
        holds(&jumped.outlier.unwrap(), &["line 988: the", "speed of its positions"]);
        near(jumped.speed_mm_s[100], 100.0, 1e-6);
    }

    #[test]
    fn what_is_no_acceleration_is_left_out_and_told() {
        let (_folder, path) = new_file("a.csv");
        let read_as = |header: &str, end: &str| {
            let rows = (0..500).map(|n| format!("{n},100,1,{}{end}\n", n % 7));
            let text = format!("time_ms,speed_mm_s,force_n,{header}\n{}", rows.collect::<String>());
            std::fs::write(&path, text).unwrap();
            read(&path, None, None).unwrap()
        };
        let beside = read_as("accel,friction,state", ",0.46,sliding");
        let told = "column 'friction' and 1 other are left out";
        holds(&beside.remarks.concat(), &[told]);
        assert_eq!(beside.axes, read_as("accel", "").axes);
    }
}
