//! Recordings as CSV: one to three columns of samples, and optionally `time_s`, which gives the sample rate.

use std::path::Path;

use super::rate::{length_fault, rate_fault};
use super::source::{Cut, MAX_CHANNELS, Source};
use super::times::rate_of;
use crate::support::csv_table::{CsvTable, Header, Row, TABLE};
use crate::support::error::{Error, Result};

/// Column of the time of each sample, s.
const TIME_COLUMN: &str = "time_s";

/// Largest deviation of a step of the first column from the mean step, as a share of it, at which it counts as times.
const UNEVENNESS: f64 = 0.5;

/// Names of columns that hold a time, in lower case, without a unit.
const TIME_NAMES: [&str; 4] = ["time", "t", "timestamp", "zeit"];

/// Columns of a free hand's recording.
const MOTION_COLUMNS: [&str; 2] = ["speed_mm_s", "force_n"];

/// Names of columns that count lines or samples, in lower case.
const COUNTER_NAMES: [&str; 3] = ["index", "sample", "frame"];

/// Fewest values from which a column without a name is taken for times.
const LEAST_TIMES: usize = 8;

/// Reads the part of a CSV file within `cut`.
///
/// A first line with a field that is not a number is a header. Without a column `time_s`, `sample_rate_hz` must be
/// given.
pub(super) fn read(path: &Path, cut: &Cut, sample_rate_hz: Option<f64>) -> Result<Source> {
    // Regular files alone, because a recording is read again: for its kind, and for the hash of its bytes.
    TABLE.open(path)?;
    let table = CsvTable::read(path, TABLE)?;
    let mut rows = table.rows();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut names: Option<Header<'_>> = None;
    while let Some(row) = rows.next_row()? {
        if columns.is_empty() {
            columns.resize(row.width(), Vec::new());
            if row.fields().any(|field| table.number(field).is_none()) {
                refuse_numbers_in_header(&row, &table)?;
                names = Some(table.header()?);
                continue;
            }
        }
        for (index, column) in columns.iter_mut().enumerate() {
            column.push(row.number(index)?);
        }
    }
    let time_column = match &names {
        Some(names) => time_column(names)?,
        None => None,
    };
    let time = time_column.map(|index| columns.remove(index));
    if columns.is_empty() || columns.len() > MAX_CHANNELS {
        let problem = format!(
            "{} columns of samples ({}): give 1 to {MAX_CHANNELS}, one per axis, and name a column of times \
             '{TIME_COLUMN}'",
            columns.len(),
            table.conventions()
        );
        return Err(Error::file(path, problem));
    }
    if names.is_none() {
        refuse_times_without_a_name(path, &columns)?;
    }
    let rate_hz = match (time, sample_rate_hz) {
        (Some(time), _) => near_whole(rate_of(&table, TIME_COLUMN, &time)?),
        (None, Some(rate_hz)) => rate_hz,
        (None, None) => {
            let problem = "has no sample rate: add a column 'time_s' to it, or a column 'sample_rate_hz' to \
                           trials.csv, or give --sample-rate";
            return Err(Error::file(path, problem));
        }
    };
    let remedy = "mend sample_rate_hz, or give --sample-rate; a column 'time_s' holds seconds";
    if let Some(fault) = rate_fault(rate_hz, remedy) {
        return Err(Error::file(path, fault));
    }
    let (first, end) = cut.frames(rate_hz);
    for column in &mut columns {
        column.truncate(end);
        column.drain(..first.min(column.len()));
    }
    let kept = columns.first().map_or(0, Vec::len);
    if let Some(fault) = length_fault(kept as f64) {
        return Err(Error::file(path, fault));
    }
    Ok(Source {
        rate_hz,
        first_frame: first,
        channels: columns,
        truncation: None,
    })
}

/// Returns the index of the column of times, after a check that every other column can be an axis.
fn time_column(names: &Header<'_>) -> Result<Option<usize>> {
    for (index, name) in names.names().enumerate() {
        let lower = name.to_lowercase();
        let stem = lower.split(['_', ' ', '[', '(']).next().unwrap_or_default();
        let problem = if MOTION_COLUMNS.contains(&name) {
            format!(
                "has a column '{name}': cut a free hand's recording with 'stylus segment' first"
            )
        } else if name != TIME_COLUMN && TIME_NAMES.contains(&stem) {
            format!(
                "has a column '{name}': name it '{TIME_COLUMN}' if it is the time in seconds, or remove it"
            )
        } else if COUNTER_NAMES.contains(&stem) && names.width() > 1 {
            format!(
                "has a column '{name}', which is no acceleration: remove column {}",
                index + 1
            )
        } else if lower == "scale_m_s2" || lower == "file" || lower == "texture" {
            format!(
                "has a column '{name}': is it a list of trials? Give it alone, and with speed_mm_s and force_n"
            )
        } else {
            continue;
        };
        return Err(names.error(problem));
    }
    names.column(TIME_COLUMN)
}

/// The whole rate next to `rate_hz`, if it is close: times are often printed with few digits.
fn near_whole(rate_hz: f64) -> f64 {
    let whole = rate_hz.round();
    if (rate_hz / whole - 1.0).abs() < 1e-3 {
        whole
    } else {
        rate_hz
    }
}

/// Refuses a header that is a line of numbers with one that cannot be read.
fn refuse_numbers_in_header(header: &Row<'_, '_>, table: &CsvTable) -> Result<()> {
    let is_number = |field: &str| table.number(field).is_some();
    let Some((index, bad)) = header
        .fields()
        .enumerate()
        .find(|(_, field)| !is_number(field))
    else {
        return Ok(());
    };
    if !header.fields().any(is_number) && !bad.starts_with(|c: char| c.is_ascii_digit() || c == '-')
    {
        return Ok(());
    }
    Err(header.error(format!(
        "'{bad}' in column {} is neither a number nor, beside numbers, a name ({}; decimal commas need another \
         separator)",
        index + 1,
        table.conventions()
    )))
}

/// Refuses a first column that rises in even steps, which is no acceleration.
fn refuse_times_without_a_name(path: &Path, columns: &[Vec<f64>]) -> Result<()> {
    let [first, _, ..] = columns else {
        return Ok(());
    };
    let (Some(&begin), Some(&end)) = (first.first(), first.last()) else {
        return Ok(());
    };
    let step = (end - begin) / (first.len() - 1).max(1) as f64;
    let even = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= UNEVENNESS * step;
    if first.len() >= LEAST_TIMES && step > 0.0 && first.windows(2).all(even) {
        let problem = format!(
            "has no header, and its first column rises in even steps of {step}: add a header that names it \
             '{TIME_COLUMN}', or remove it"
        );
        return Err(Error::file(path, problem));
    }
    Ok(())
}
