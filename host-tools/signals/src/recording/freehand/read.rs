//! CSV files of a free hand's recording with its motion.

use std::io::Read;
use std::path::Path;

use serde::Serialize;

use super::positions::{self, PositionColumn};
use crate::recording::axes::LeftOut;
use crate::recording::stamps::even_rate;
use crate::recording::time_unit::{TimeColumn, TimeUnit};
use crate::recording::{MAX_CHANNELS, MAX_FRAMES, SampleRate};
use crate::recording::{lvm, unit};
use crate::support::bounded_file::Format;
use crate::support::csv_table::{CsvTable, Header, Row, comment};
use crate::support::error::{Error, Result};
use crate::support::hand::{MAX_FORCE_N, MAX_SPEED_MM_S};

/// Names of the columns other than accelerations.
const TIME: &str = "time_s";
const SPEED: &str = "speed_mm_s";
const FORCE: &str = "force_n";

/// Largest magnitude of an acceleration that the stylus can play. A larger value is an outlier, and so are motions that
/// no hand can perform.
const MAX_ACCELERATION_M_S2: f64 = 2048.0;

/// Largest fraction of samples with an outlier; a file with more is refused.
const MAX_OUTLIER_SHARE: f64 = 0.1;

/// Largest number of outliers that are reported one by one.
const NAMED_OUTLIERS: usize = 20;

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
    /// The first outliers, at most 20.
    pub outliers: Vec<Outlier>,
    /// True if the file states that it is simulated.
    pub is_simulated: bool,
    /// Conversions of units, and doubts about them, one line each.
    pub remarks: Vec<String>,
}

impl Freehand {
    /// Returns notes on units and outliers of the recording in the file at `path`, one line each.
    pub fn notes(&self, path: &Path) -> Vec<String> {
        let path = path.display();
        let remarks = self.remarks.iter().map(|remark| format!("{path}: {remark}"));
        let named = self.outliers.iter().map(|outlier| {
            format!(
                "{path}, line {}: {} is {}, which is out of range; cut out",
                outlier.line, outlier.column, outlier.value
            )
        });
        let mut notes: Vec<String> = remarks.chain(named).collect();
        let all = self.is_outlier.iter().filter(|bad| **bad).count();
        if all > self.outliers.len() {
            notes.push(format!("{path}: {all} samples in total are out of range"));
        }
        notes
    }

    /// Appends a row, whose accelerations are in units of `scales_m_s2`; an outlier becomes 0. `names` are the names of
    /// the row's columns. If the row has positions in place of a speed, they are appended to `positions_mm`.
    fn push(
        &mut self,
        row: &Row<'_, '_>,
        columns: &Columns,
        names: &[&str],
        scales_m_s2: &[f64],
        positions_mm: &mut [Vec<f64>],
    ) -> Result<()> {
        let mut bad = false;
        let mut keep = |index: usize, value: f64, limit: f64| {
            if value.is_finite() && value.abs() <= limit {
                return value;
            }
            bad = true;
            if self.outliers.len() < NAMED_OUTLIERS {
                self.outliers.push(Outlier {
                    line: row.line,
                    column: names[index].to_owned(),
                    value,
                });
            }
            // Segments and strokes leave out a block with an outlier, so any finite number will do for them.
            0.0
        };
        if let Some(index) = columns.speed {
            let speed = keep(index, row.number(index)?, MAX_SPEED_MM_S);
            self.speed_mm_s.push(speed.abs());
            self.is_backward.push(speed < 0.0);
        }
        for (axis, column) in positions_mm.iter_mut().zip(&columns.positions) {
            let position_mm = column.unit_mm * row.finite(column.index, names[column.index])?;
            axis.push(position_mm);
        }
        let force = keep(columns.force, row.number(columns.force)?, MAX_FORCE_N);
        for ((axis, &index), scale) in self.axes.iter_mut().zip(&columns.axes).zip(scales_m_s2) {
            axis.push(keep(index, scale * row.number(index)?, MAX_ACCELERATION_M_S2));
        }
        self.force_n.push(force);
        self.is_outlier.push(bad);
        Ok(())
    }

    /// Adds the speeds of all rows, mm/s, as positions give them. One that no hand can perform is an outlier.
    fn follow(&mut self, table: &CsvTable, speeds_mm_s: &[f64]) {
        for (index, &value) in speeds_mm_s.iter().enumerate() {
            let is_bad = value.abs() > MAX_SPEED_MM_S;
            if is_bad && self.outliers.len() < NAMED_OUTLIERS {
                self.outliers.push(Outlier {
                    line: table.line_of_row(index + 1),
                    column: "the speed of its positions".to_owned(),
                    value,
                });
            }
            self.is_outlier[index] |= is_bad;
            self.speed_mm_s.push(if is_bad { 0.0 } else { value.abs() });
            self.is_backward.push(value < 0.0);
        }
    }
}

/// A value that no hand and no sensor can produce.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outlier {
    /// Line of the value in the file, from 1.
    pub line: u64,
    /// Name of the value's column.
    pub column: String,
    /// The value.
    pub value: f64,
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
/// they are in the unit of the header, or m/s². If accelerations are named, other columns are left out.
///
/// A column of times, such as `time_s` or `time_ms`, is necessary unless `rate_hz` is given. Comments begin with `#`; a
/// comment at the top that begins with SIMULATED marks the file as simulated.
///
/// # Errors
/// The file cannot be read or lacks one of these columns, a field is not a number, the times are not even, the rate is
/// not possible for a recording, or there are too many rows or outliers.
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
    let left_out = columns.left_out.remarks.iter().cloned();
    let remarks = left_out.chain(stated.conversion(scale_m_s2));
    let mut recording = Freehand {
        rate_hz: 0.0,
        axes: vec![Vec::new(); axes.len()],
        speed_mm_s: Vec::new(),
        force_n: Vec::new(),
        is_outlier: Vec::new(),
        outliers: Vec::new(),
        is_backward: Vec::new(),
        is_simulated: is_simulated(path)?,
        remarks: remarks.chain(stated.doubt(scale_m_s2)).collect(),
    };
    let (mut times, mut positions_mm) = (Vec::new(), vec![Vec::new(); columns.positions.len()]);
    let mut rows = table.rows_below_header()?;
    while let Some(row) = rows.next_row()? {
        if let Some((time, unit)) = columns.time {
            times.push(row.number(time)? / unit.per_second());
        }
        recording.push(&row, &columns, &names, &scales_m_s2, &mut positions_mm)?;
        if recording.is_outlier.len() > MAX_FRAMES {
            let problem = format!("more than {MAX_FRAMES} rows: cut the file");
            return Err(row.error(problem));
        }
    }
    recording.rate_hz = rate_of(&table, &times, rate_hz)?;
    if columns.speed.is_none() {
        let speeds_mm_s = positions::speed_mm_s(&positions_mm, recording.rate_hz);
        recording.follow(&table, &speeds_mm_s);
    }
    refuse_too_many_outliers(path, &recording)?;
    Ok(recording)
}

fn refuse_too_many_outliers(path: &Path, recording: &Freehand) -> Result<()> {
    let count = recording.is_outlier.iter().filter(|bad| **bad).count();
    let most = MAX_OUTLIER_SHARE * recording.is_outlier.len() as f64;
    if recording.is_outlier.is_empty() {
        return Err(Error::file(path, "holds no samples"));
    }
    if count as f64 > most {
        let first = &recording.outliers[0];
        let problem = format!(
            "{count} of {} samples have impossible values (line {}: {} is {}): check its columns and units",
            recording.is_outlier.len(),
            first.line,
            first.column,
            first.value
        );
        return Err(Error::file(path, problem));
    }
    Ok(())
}

/// Indices of a file's columns.
struct Columns {
    time: Option<(usize, TimeUnit)>,
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
        let samples = header.names().enumerate();
        let samples = samples.filter(|(index, _)| Some(*index) != speed && *index != force && !is_time(index));
        let is_position = |index: usize| speed.is_none() && positions.iter().any(|position| position.index == index);
        let samples = samples.filter(|(index, _)| !is_position(*index));
        let samples: Vec<(usize, &str)> = samples.collect();
        let left_out = LeftOut::of(&samples);
        let axes = samples.iter().map(|(index, _)| *index);
        let axes: Vec<usize> = axes.filter(|&index| !left_out.contains(index)).collect();
        let time = TimeColumn::best(&times);
        let time = time.map(|time| (time.index, time.unit.unwrap_or(TimeUnit::S)));
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
}

/// Returns the given rate, or that of the times, which must ascend in even steps, in Hz.
fn rate_of(table: &CsvTable, times: &[f64], given: Option<f64>) -> Result<f64> {
    let rate_hz = match given {
        Some(rate_hz) => rate_hz,
        None if times.is_empty() => {
            let problem = format!("has no sample rate: add a column '{TIME}', or give --sample-rate");
            return Err(Error::file(table.path(), problem));
        }
        // Times are often written with few digits, so their rate is rounded.
        None => even_rate(table, TIME, times)?.round(),
    };
    let rate = SampleRate::new(
        rate_hz,
        &format!("a column '{TIME}' holds seconds, or give --sample-rate"),
    );
    Ok(rate.map_err(|fault| Error::file(table.path(), fault))?.hz())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_any_unit_give_the_same_recording() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        // 90 mm/s along x and 120 mm/s along y.
        let rows = (0..2000).map(|n| {
            let s = f64::from(n) / 1000.0;
            format!("{s},{},{},1,{},1\n", 90.0 * s, 0.12 * s, n % 7)
        });
        let rows: String = rows.collect();
        std::fs::write(
            &path,
            format!("Time (s),Pos X (mm),y_m,Normal Force (N),ax,gyro\n{rows}"),
        )
        .unwrap();
        let of_positions = read(&path, None, None).unwrap();
        assert!(of_positions.speed_mm_s.iter().all(|speed| (speed - 150.0).abs() < 1e-6));
        assert_eq!((of_positions.axes.len(), of_positions.outliers.len()), (1, 0));
        // A tracker that jumps by 100 mm for one sample.
        let rows = (0..2000).map(|n| {
            let mm = if n == 1000 { 200.0 } else { 0.1 * f64::from(n) };
            format!("{n},{mm},1,{}\n", n % 7)
        });
        let jump = format!("time_ms,position_mm,force_n,ax\n{}", rows.collect::<String>());
        std::fs::write(&path, jump).unwrap();
        let jumped = read(&path, None, None).unwrap();
        let bad = jumped.is_outlier.iter().filter(|bad| **bad).count();
        assert!((1..40).contains(&bad) && jumped.outliers[0].line > 950, "{bad}");
        assert!((jumped.speed_mm_s[100] - 100.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_acceleration_is_left_out_and_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let read_as = |header: &str, end: &str| {
            let rows = (0..500).map(|n| format!("{n},100,1,{}{end}\n", n % 7));
            let text = format!("time_ms,speed_mm_s,force_n,{header}\n{}", rows.collect::<String>());
            std::fs::write(&path, text).unwrap();
            read(&path, None, None).unwrap()
        };
        let beside = read_as("accel,friction,state", ",0.46,sliding");
        let told = "column 'friction' and 1 other are left out";
        test_helpers::holds(&beside.remarks.concat(), &[told]);
        assert_eq!(beside.axes, read_as("accel", "").axes);
    }
}
