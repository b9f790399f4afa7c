//! Recordings as CSV: one to three columns of samples, and optionally `time_s`, which gives the sample rate.

use std::path::Path;

use super::rate::{MAX_FRAMES, length_fault, rate_fault};
use super::source::{Cut, Integers, MAX_CHANNELS, Source};
use super::uneven::{LARGEST_DEVIATION, Steps, are_even};
use super::unit;
use crate::support::csv_table::{CsvTable, Header, Row, TABLE};
use crate::support::error::{Error, Result};

/// Column of the time of each sample, s.
const TIME_COLUMN: &str = "time_s";

/// Names of columns that hold a time, in lower case, without a unit: in seconds, as the bounds of rates tell, because
/// milliseconds would be a rate a thousand times too low.
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
    read_table(&CsvTable::read(path, TABLE)?, cut, sample_rate_hz)
}

/// Reads the part of a `table` within `cut`, as [`read`] does that of a file.
pub(super) fn read_table(
    table: &CsvTable,
    cut: &Cut,
    sample_rate_hz: Option<f64>,
) -> Result<Source> {
    let path = table.path();
    let mut rows = table.rows()?;
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut names: Option<Header<'_>> = None;
    let mut time_column = None;
    // A second line of the header, as oscilloscopes write it.
    let mut units: Vec<String> = Vec::new();
    while let Some(row) = rows.next_row()? {
        if columns.is_empty() {
            let is_header = row.fields().any(|field| table.number(field).is_none());
            if is_header {
                refuse_numbers_in_header(&row, table)?;
                let header = table.header()?;
                time_column = self::time_column(&header)?;
                names = Some(header);
            }
            refuse_other_widths(table, row.width(), time_column.is_some())?;
            columns.resize(row.width(), Vec::new());
            if is_header {
                continue;
            }
        }
        if names.is_some()
            && units.is_empty()
            && columns[0].is_empty()
            && unit::is_row(row.fields())
        {
            units.extend(row.fields().map(str::to_owned));
            continue;
        }
        for (index, column) in columns.iter_mut().enumerate() {
            column.push(row.number(index)?);
        }
        if columns[0].len() > MAX_FRAMES {
            let problem = format!("more than {MAX_FRAMES} rows: cut the file");
            return Err(row.error(problem));
        }
    }
    if columns.is_empty() {
        refuse_other_widths(table, 0, false)?;
    }
    let time = time_column.map(|index| columns.remove(index));
    if names.is_none() {
        refuse_times_without_a_name(path, &columns)?;
    }
    let mut with_units = names_with_units(names.as_ref(), &units, time_column);
    with_units.resize(columns.len(), String::new());
    let stated = unit::stated(&with_units, &table.comments()?);
    let integers = counts(&columns).or(stated.counts());
    let rate_hz = rate_hz(table, time.as_deref(), sample_rate_hz)?;
    let (first, end) = cut.frames(rate_hz);
    let mut times_s = time.filter(|times| rate_hz.fract() != 0.0 || !are_even(times));
    for column in columns.iter_mut().chain(&mut times_s) {
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
        times_s,
        truncation: None,
        stated,
        integers,
        remarks: Vec::new(),
    })
}

/// The sample rate of a `table` with these times, or as it is given, Hz.
fn rate_hz(table: &CsvTable, time: Option<&[f64]>, given: Option<f64>) -> Result<f64> {
    let path = table.path();
    let rate_hz = match (time, given) {
        (Some(time), _) => near_whole(rate_of(table, TIME_COLUMN, time, Steps::hold)?),
        (None, Some(rate_hz)) => rate_hz,
        (None, None) => {
            let problem = "has no sample rate: add a column 'time_s' to it, or a column 'sample_rate_hz' to \
                           trials.csv, or give --sample-rate";
            return Err(Error::file(path, problem));
        }
    };
    let remedy =
        "mend sample_rate_hz, or give --sample-rate; a column 'time_s' or 'time' holds seconds";
    if let Some(fault) = rate_fault(rate_hz, remedy) {
        return Err(Error::file(path, fault));
    }
    Ok(rate_hz)
}

/// Names of the columns of samples, with the `units` of a second line below them, if there is one.
fn names_with_units(
    names: Option<&Header<'_>>,
    units: &[String],
    time: Option<usize>,
) -> Vec<String> {
    let units = units
        .iter()
        .map(String::as_str)
        .chain(std::iter::repeat(""));
    let names = names
        .into_iter()
        .flat_map(Header::names)
        .zip(units)
        .enumerate();
    let samples = names.filter(|(index, _)| Some(*index) != time);
    samples
        .map(|(_, (name, unit))| format!("{name} [{}]", unit::bare(unit)))
        .collect()
}

/// Steps of a converter, which are whole numbers.
fn counts(columns: &[Vec<f64>]) -> Option<Integers> {
    let mut samples = columns.iter().flatten();
    let are_whole = samples.clone().all(|sample| sample.fract() == 0.0);
    (are_whole && samples.any(|sample| sample.abs() > 1.0)).then_some(Integers::Counts)
}

/// Refuses a table of another number of columns of samples than a recording has.
fn refuse_other_widths(table: &CsvTable, width: usize, has_times: bool) -> Result<()> {
    let problem = match width - usize::from(has_times) {
        0 if has_times => "has times alone: add a column of samples for each axis".to_owned(),
        0 => "is empty: give a row for each sample".to_owned(),
        1..=MAX_CHANNELS => return Ok(()),
        count => format!(
            "{count} columns of samples ({}): give 1 to {MAX_CHANNELS}, one per axis, and name a column of times \
             '{TIME_COLUMN}'",
            table.conventions()
        ),
    };
    Err(Error::file(table.path(), problem))
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
        } else if name != TIME_COLUMN && TIME_NAMES.contains(&stem) && lower.contains("ms") {
            format!(
                "has a column '{name}': divide it by 1000 and name it '{TIME_COLUMN}', or remove it"
            )
        } else if name != TIME_COLUMN && TIME_NAMES.contains(&stem) && lower != stem {
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
    let is_time = |name: &str| TIME_NAMES.contains(&name.to_lowercase().as_str());
    let bare = names.names().position(is_time);
    Ok(names.column(TIME_COLUMN)?.or(bare))
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
    let even = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= LARGEST_DEVIATION * step;
    if first.len() >= LEAST_TIMES && step > 0.0 && first.windows(2).all(even) {
        let problem = format!(
            "has no header, and its first column rises in even steps of {step}: add a header that names it \
             '{TIME_COLUMN}', or remove it"
        );
        return Err(Error::file(path, problem));
    }
    Ok(())
}

/// Returns the sample rate of the times in `column` of `table`, one per row below its header, in Hz.
///
/// # Errors
/// Fewer than two times; a time that does not rise, or a gap, with its line.
pub(super) fn rate_of(
    table: &CsvTable,
    column: &str,
    times: &[f64],
    hold: impl Fn(&Steps, f64) -> bool,
) -> Result<f64> {
    let path = table.path();
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err(Error::file(path, "holds no samples"));
    };
    if times.len() == 1 {
        let problem = "holds one sample, whose time tells no sample rate: record for longer";
        return Err(Error::file(path, problem));
    }
    let steps = Steps::of(times);
    let bad = |pair: &[f64]| !hold(&steps, pair[1] - pair[0]);
    if let Some(index) = times.windows(2).position(bad) {
        let problem = step_fault(column, times[index], times[index + 1], steps.usual_s);
        return Err(Error::line(path, table.line_of_row(index + 2), problem));
    }
    let step = (last - first) / (times.len() - 1) as f64;
    if !step.is_finite() {
        let problem = format!("its column '{column}' does not hold seconds");
        return Err(Error::file(path, problem));
    }
    Ok(1.0 / step)
}

/// The problem of a step from `before` to `time`, s, where steps are `usual`, in words.
fn step_fault(column: &str, before: f64, time: f64, usual: f64) -> String {
    let step = time - before;
    if step > 0.0 && step.is_finite() && usual > 0.0 {
        let (kind, remedy) = if step > usual {
            (
                "a gap",
                "times must rise in even steps; cut the file there, or record it again",
            )
        } else {
            ("a short step", "resample it to even steps first")
        };
        format!(
            "{column} is {time} after {before}: {kind} of {step:.6} s where lines are {usual:.6} s apart; {remedy}"
        )
    } else if step == 0.0 {
        format!(
            "{column} is {time} as in the line before: write times with more digits, or remove the line"
        )
    } else {
        format!(
            "{column} is {time} after {before}: times must rise in even steps; cut the file there"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::holds;
    use proptest::prelude::*;
    use std::path::Path;

    fn rate(times: &[f64]) -> Result<f64> {
        let mut text = String::from("# x\ntime_s,x\n");
        for time in times {
            text += &format!("{time},1\n");
        }
        let table = CsvTable::of(Path::new("a.csv"), text).unwrap();
        rate_of(&table, "time_s", times, Steps::hold)
    }

    proptest! {
        #[test]
        fn a_gap_and_a_step_back_are_named_with_their_line(
            at in 1usize..999, step_s in 1e-5..0.1f64, share in prop::sample::select(vec![-40.0, -1.0, 0.6, 30.0, 0.0]),
        ) {
            let mut times: Vec<f64> = (0..1000).map(|n| step_s * f64::from(n)).collect();
            prop_assert!((rate(&times).unwrap() * step_s - 1.0).abs() < 1e-6);
            // A step of zero is a line that repeats its time.
            let off = if share == 0.0 { -step_s } else { share * step_s };
            times[at..].iter_mut().for_each(|time| *time += off);
            if share == 0.0 {
                times[at] = times[at - 1];
            }
            let message = rate(&times).unwrap_err().to_string();
            let words = [(-40.0, "must rise"), (-1.0, ""), (0.6, "a gap"), (30.0, "a gap"), (0.0, "")];
            let word = words.iter().find(|(of, _)| *of == share).map_or("", |(_, word)| word);
            prop_assert!(message.contains(&format!("line {}:", at + 3)), "{}", message);
            prop_assert!(message.contains(word), "{}", message);
        }
    }

    #[test]
    fn times_that_tell_no_rate_are_refused() {
        for times in [
            &[][..],
            &[1.0],
            &[0.0, 0.0, 0.0],
            &[0.0, f64::NAN],
            &[0.0, f64::INFINITY],
        ] {
            assert!(rate(times).is_err(), "{times:?}");
        }
        let message = rate(&[0.0, 0.001, 0.001, 0.002]).unwrap_err();
        holds(&message, &["line 5", "more digits"]);
    }
}
