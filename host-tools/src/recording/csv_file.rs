//! Recordings as CSV: one to three columns of samples, and optionally `time_s`, which gives the sample rate.

use std::path::Path;

use super::csv_table::{csv_error, csv_table};
use super::source::{Cut, MAX_CHANNELS, Source};
use crate::support::error::{Error, Result};

/// Column of the time of each sample, s.
const TIME_COLUMN: &str = "time_s";

/// Largest deviation of a step of the time column from the mean step, as a share of it.
const UNEVENNESS: f64 = 0.5;

/// Reads the part of a CSV file within `cut`.
///
/// A first line that holds anything but numbers is a header. Without a column `time_s`, `sample_rate_hz` must be given.
pub(super) fn read(path: &Path, cut: &Cut, sample_rate_hz: Option<f64>) -> Result<Source> {
    let mut reader = csv_table()
        .has_headers(false)
        .from_path(path)
        .map_err(|failure| csv_error(path, failure))?;
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut time_column = None;
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|failure| csv_error(path, failure))?;
        let line = record.position().map_or(0, csv::Position::line);
        if number == 0 {
            columns.resize(record.len(), Vec::new());
            if record.iter().any(|field| field.parse::<f64>().is_err()) {
                time_column = record.iter().position(|name| name == TIME_COLUMN);
                continue;
            }
        }
        for (column, field) in columns.iter_mut().zip(&record) {
            let value = field
                .parse()
                .map_err(|_| Error::line(path, line, format!("'{field}' is not a number")))?;
            column.push(value);
        }
    }
    let time = time_column.map(|index| columns.remove(index));
    if columns.is_empty() || columns.len() > MAX_CHANNELS {
        let problem = format!(
            "{} columns of samples: give 1 to {MAX_CHANNELS}, one per axis",
            columns.len()
        );
        return Err(Error::file(path, problem));
    }
    let rate_hz = match (time, sample_rate_hz) {
        (Some(time), _) => rate_of(path, &time)?,
        (None, Some(rate_hz)) => rate_hz,
        (None, None) => {
            let problem = "has no sample rate: add a column 'time_s' to it, or a column 'sample_rate_hz' to \
                           trials.csv, or give --sample-rate";
            return Err(Error::file(path, problem));
        }
    };
    let (first, end) = cut.frames(rate_hz);
    for column in &mut columns {
        column.truncate(end);
        column.drain(..first.min(column.len()));
    }
    Ok(Source {
        rate_hz,
        first_frame: first,
        channels: columns,
    })
}

/// Returns the sample rate of evenly spaced times, in Hz.
fn rate_of(path: &Path, time: &[f64]) -> Result<f64> {
    let (Some(first), Some(last)) = (time.first(), time.last()) else {
        return Err(Error::file(path, "holds no samples"));
    };
    let step = (last - first) / (time.len() - 1).max(1) as f64;
    let even = |pair: &[f64]| ((pair[1] - pair[0]) / step - 1.0).abs() <= UNEVENNESS;
    if !step.is_finite() || step <= 0.0 || !time.windows(2).all(even) {
        let problem = "its column 'time_s' does not ascend in even steps; resample it first";
        return Err(Error::file(path, problem));
    }
    let rate_hz = 1.0 / step;
    // Times are often printed with few digits, so that a rate close to a whole number is that number.
    let whole = rate_hz.round();
    Ok(if (rate_hz / whole - 1.0).abs() < 1e-3 {
        whole
    } else {
        rate_hz
    })
}
