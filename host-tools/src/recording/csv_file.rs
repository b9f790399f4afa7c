//! Recordings as CSV: one to three columns of samples, and `time_s` if the file tells its own rate.

use std::path::Path;

use super::MAX_CHANNELS;
use super::set::csv_error;
use super::source::{Cut, Source};
use crate::support::error::{Error, Result};

/// The column that tells when each line was sampled, s.
const TIME_COLUMN: &str = "time_s";

/// How far steps of the time column may be from even, as a share of a step.
const UNEVENNESS: f64 = 0.5;

/// Reads the part of a CSV file that `cut` asks for.
///
/// A first line that is not all numbers is a header. Without a column `time_s`, `sample_rate_hz` must be given.
pub(super) fn read(path: &Path, cut: &Cut, sample_rate_hz: Option<f64>) -> Result<Source> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
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
            "{} columns of samples; there may be 1 to {MAX_CHANNELS}, one an axis",
            columns.len()
        );
        return Err(Error::file(path, problem));
    }
    let rate_hz = match (time, sample_rate_hz) {
        (Some(time), _) => rate_of(path, &time)?,
        (None, Some(rate_hz)) => rate_hz,
        (None, None) => {
            let problem = "does not tell its sample rate: give a column 'time_s' in it, or \
                           'sample_rate_hz' in trials.csv, or --sample-rate";
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

/// The rate of evenly spaced times.
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
    // Times are often printed with few digits; a rate a hair off a whole number is that number.
    let whole = rate_hz.round();
    Ok(if (rate_hz / whole - 1.0).abs() < 1e-3 {
        whole
    } else {
        rate_hz
    })
}
