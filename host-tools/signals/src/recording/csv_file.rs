//! Recordings as CSV: one to three columns of samples, and optionally a column of times, which gives the sample rate.
//! Columns whose names show that they do not contain an axis are left out.

use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, Header, Row};
use stylus_support::{Error, Result};

use super::axes::{self, LeftOut};
use super::clock::{self, TimeFacts};
use super::kind::remedy;
use super::rate::{MAX_CHANNELS, SampleRate, length_fault, most_frames};
use super::times::{self, TimeColumn, TimeUnit};
use super::trial::Trial;
use super::trial::{Cut, Source};
use super::unit::{self, Unscaled};

/// Column of the time of each sample, s.
const TIME_COLUMN: &str = "time_s";

/// First words of names that may denote a time.
const TIME_WORDS: [&str; 4] = ["time", "t", "timestamp", "zeit"];

/// Columns of a free hand's recording.
const MOTION_COLUMNS: [&str; 2] = ["speed_mm_s", "force_n"];

/// Names of columns that count lines or samples, in lower case.
const COUNTER_NAMES: [&str; 3] = ["index", "sample", "frame"];

/// Least number of values for which a column without a name can be recognised as times.
const LEAST_TIMES: usize = 8;

/// Fields that stand for a missing value, in lower case: of spreadsheets, pandas, R and SQL.
const NO_VALUE: [&str; 5] = ["", "na", "n/a", "#n/a", "null"];

/// Reads the part of the CSV file of `trial` within `cut`.
///
/// If the first line has a field that is not a number, it is a header. Without a column of times, the trial must have a
/// sample rate.
pub(super) fn read(trial: &Trial, cut: &Cut) -> Result<Source> {
    let path = trial.file.as_path();
    // Only regular files are accepted, because a recording is read again: for its kind, and for the hash of its bytes.
    Format::Table.open(path)?;
    let table = CsvTable::read(path, Format::Table)?;
    read_table(&table, trial, None, cut).map_err(|error| with_remedy(error, &table))
}

/// Returns the `error` about a `table` with what the file is and the remedy, if its text shows it.
fn with_remedy(mut error: Error, table: &CsvTable) -> Error {
    let (line, problem) = match &mut error {
        Error::Line { line, problem, .. } => (*line, problem),
        Error::File { problem, .. } => (0, problem),
        _ => return error,
    };
    let found = table
        .excerpt(line)
        .ok()
        .and_then(|text| remedy(&format!("line {line}: {problem}\n{text}")));
    problem.extend(found.map(|words| format!("; {words}")));
    error
}

/// Reads the part of a `table` of `trial` within `cut`, like [`read`] for a file. Without times and a given rate, its
/// rate is `told_hz`.
pub(super) fn read_table(table: &CsvTable, trial: &Trial, told_hz: Option<f64>, cut: &Cut) -> Result<Source> {
    let path = table.path();
    let remedy = "mend it, or give --sample-rate (sample_rate_hz in a list)";
    let checked = |hz: Option<f64>| hz.map(|hz| SampleRate::new(hz, remedy).map_err(|fault| Error::file(path, fault)));
    let rate = checked(trial.sample_rate_hz).transpose()?;
    let mut columns = Columns::read(table)?;
    if columns.values.is_empty() {
        refuse_other_widths(table, 0, 0)?;
    }
    if columns.names.is_none() {
        columns.find_times_without_a_name(table, trial.time_unit)?;
    }
    let time = TimeColumn::best(&columns.times);
    let times = time.map(|time| std::mem::take(&mut columns.values[time.index]));
    let names = columns.names_with_units();
    let axes: Vec<usize> = (0..columns.values.len())
        .filter(|&index| columns.is_sample(index))
        .collect();
    columns.refuse_empty(table, &axes)?;
    let of_axes = |index: &usize| names.get(*index).cloned().unwrap_or_default();
    let stated: Vec<String> = axes.iter().map(of_axes).collect();
    let stated = unit::stated(&stated, &table.comments()?);
    let channels = axes
        .iter()
        .map(|&index| std::mem::take(&mut columns.values[index]))
        .collect();
    let source = if let (Some(time), Some(times)) = (time, times) {
        let told = TimeFacts {
            column: &time.name,
            unit: trial.time_unit.or(time.unit),
            is_even: trial.has_even_times.unwrap_or(false),
            rate,
        };
        clock::source(table, &told, times, channels, cut)?
    } else {
        columns.refuse_jumps(table)?;
        let Some(rate) = rate.or(checked(told_hz).transpose()?) else {
            let problem = "has no sample rate: add a column 'time_s' to it, or give --sample-rate, or sample_rate_hz \
                           in the list";
            return Err(Error::file(path, problem));
        };
        clock::even(rate, channels, cut)
    };
    let kept = source.channels.first().map_or(0, Vec::len);
    if let Some(fault) = length_fault(kept as f64, source.channels.len()) {
        return Err(Error::file(path, fault));
    }
    Ok(Source {
        unscaled: counts(&source.channels).or(stated.counts()),
        stated,
        remarks: columns.remarks.into_iter().chain(source.remarks).collect(),
        ..source
    })
}

/// All columns of a table.
struct Columns<'a> {
    values: Vec<Vec<f64>>,
    names: Option<Header<'a>>,
    /// Units from a second line of the header, as oscilloscopes write it.
    units: Vec<String>,
    /// Columns of times, ascending.
    times: Vec<TimeColumn>,
    /// Columns that contain neither times nor an axis.
    left_out: LeftOut,
    /// What was left out or assumed, in words.
    remarks: Vec<String>,
}

impl<'a> Columns<'a> {
    fn read(table: &'a CsvTable) -> Result<Self> {
        let mut rows = table.rows()?;
        rows.end_before_cut_off();
        let mut read = Self {
            values: Vec::new(),
            names: None,
            units: Vec::new(),
            times: Vec::new(),
            left_out: LeftOut::default(),
            remarks: Vec::new(),
        };
        while let Some(row) = rows.next_row()? {
            if read.values.is_empty() {
                let is_header = row.fields().any(|field| table.number(field).is_none());
                if is_header {
                    refuse_numbers_in_header(&row, table)?;
                    read.name(table.header()?)?;
                }
                // A first column without a name may contain the times, which is determined from the rows below.
                let has_one_more = row.width() == MAX_CHANNELS + 1;
                let unnamed = usize::from(read.names.is_none() && has_one_more);
                let others = read.times.len() + read.left_out.count() + unnamed;
                refuse_other_widths(table, row.width(), others)?;
                read.values.resize(row.width(), Vec::new());
                if is_header {
                    continue;
                }
            }
            // Only the line directly below the names can hold units.
            if read.names.is_some() && read.units.is_empty() && read.values[0].is_empty() && unit::is_row(row.fields())
            {
                read.units.extend(row.fields().map(str::to_owned));
                continue;
            }
            // In the order of the columns, so that a wide row takes no longer than a narrow one of its length.
            let mut times = read.times.iter_mut().peekable();
            for (index, column) in read.values.iter_mut().enumerate() {
                let time = times.next_if(|time| time.index == index);
                column.push(match (row.number(index), time) {
                    // A time that is not a number may be a time of day or a duration, which is converted to seconds.
                    (Err(fault), Some(time)) => {
                        time.unit = Some(TimeUnit::S);
                        times::seconds(row.text(index)).ok_or(fault)?
                    }
                    (Err(_), None) if read.left_out.contains(index) || is_no_value(row.text(index)) => f64::NAN,
                    (number, _) => number?,
                });
            }
            // Refused while it is read, before it fills the memory.
            let axes = read.values.len() - read.times.len();
            let most = most_frames(axes.min(MAX_CHANNELS));
            if read.values[0].len() > most {
                let problem = format!("more than {most} rows: cut the file");
                return Err(row.error(problem));
            }
        }
        if rows.are_cut_off() {
            let remark = "its last line is cut off, and left out";
            read.remarks.push(remark.to_owned());
        }
        Ok(read)
    }

    /// Stores the names of the columns, and determines from them the columns of times and the columns that are not
    /// axes.
    fn name(&mut self, header: Header<'a>) -> Result<()> {
        self.times = time_columns(&header)?;
        let samples = header.names().enumerate().filter(|(index, _)| self.is_sample(*index));
        let mut left_out = LeftOut::of(&samples.collect::<Vec<_>>());
        self.remarks.append(&mut left_out.remarks);
        self.left_out = left_out;
        self.names = Some(header);
        Ok(())
    }

    /// If the columns have no names and the first one rises in every row, uses the first as times, because no
    /// acceleration rises like this.
    ///
    /// # Errors
    /// The first column counts rows, and its unit is not given; or there are more axes than a recording has.
    fn find_times_without_a_name(&mut self, table: &CsvTable, unit: Option<TimeUnit>) -> Result<()> {
        let width = self.values.len();
        if let [first, _, ..] = self.values.as_slice()
            && first.len() >= LEAST_TIMES
            && first.windows(2).all(|pair| pair[1] > pair[0])
        {
            // A counter looks like times in ms at 1 kHz, so only a unit decides.
            if unit.is_none() && first.windows(2).all(|pair| pair[1] - pair[0] == 1.0) {
                let problem = format!(
                    "has no header, and its first column counts: add a header that names it '{TIME_COLUMN}' or \
                     'time_ms', or remove it"
                );
                return Err(Error::file(table.path(), problem));
            }
            let name = "column 1".to_owned();
            self.times.push(TimeColumn { index: 0, name, unit });
            self.remarks
                .push("its first column, which has no name and rises, is taken for times".to_owned());
        }
        refuse_other_widths(table, width, self.times.len())
    }

    /// Refuses a column among `axes` that contains no number.
    fn refuse_empty(&self, table: &CsvTable, axes: &[usize]) -> Result<()> {
        let is_empty = |index: &&usize| {
            let column = &self.values[**index];
            !column.is_empty() && column.iter().all(|value| value.is_nan())
        };
        let Some(index) = axes.iter().find(is_empty) else {
            return Ok(());
        };
        let problem = format!("column {} holds no numbers: remove it", index + 1);
        Err(Error::file(table.path(), problem))
    }

    /// Refuses a counter that does not count every row. Without times, only the counter shows that samples are missing.
    fn refuse_jumps(&self, table: &CsvTable) -> Result<()> {
        for (index, name) in self
            .names
            .iter()
            .flat_map(Header::names)
            .enumerate()
            .filter(|(_, name)| COUNTER_NAMES.contains(&stem(name).as_str()))
        {
            let jumps = |pair: &[f64]| (pair[1] - pair[0] - 1.0).abs() > 0.0;
            let Some(row) = self.values[index].windows(2).position(jumps) else {
                continue;
            };
            let (before, count) = (self.values[index][row], self.values[index][row + 1]);
            let problem = format!(
                "{name} is {count} after {before}, so samples may be missing: add a column '{TIME_COLUMN}', or remove \
                 column {} if none are",
                index + 1
            );
            // The header is a row, too.
            return Err(Error::line(table.path(), table.line_of_row(row + 2), problem));
        }
        Ok(())
    }

    /// Returns true if the column with this index contains an axis.
    fn is_sample(&self, index: usize) -> bool {
        !self.left_out.contains(index) && TimeColumn::of(&self.times, index).is_none()
    }

    /// Returns the names of all columns, with the units from a second line below them, if there is one.
    fn names_with_units(&self) -> Vec<String> {
        let units = self.units.iter().map(String::as_str).chain(std::iter::repeat(""));
        let names = self.names.iter().flat_map(Header::names).zip(units);
        let name = |(name, unit): (&str, &str)| format!("{name} [{}]", unit::bare(unit));
        names.map(name).collect()
    }
}

/// Returns true for a field that stands for a missing value.
pub(super) fn is_no_value(field: &str) -> bool {
    NO_VALUE.iter().any(|none| field.eq_ignore_ascii_case(none))
}

/// Returns [`Unscaled::Counts`] if the samples are steps of a converter, which are whole numbers.
pub(super) fn counts(columns: &[Vec<f64>]) -> Option<Unscaled> {
    let mut samples = columns.iter().flatten();
    let are_whole = samples.clone().all(|sample| sample.fract() == 0.0);
    // Samples of -1, 0 and 1 alone may be of any kind.
    (are_whole && samples.any(|sample| sample.abs() > 1.0)).then_some(Unscaled::Counts)
}

/// Refuses a table whose number of columns of samples, without the `others`, is not possible for a recording.
fn refuse_other_widths(table: &CsvTable, width: usize, others: usize) -> Result<()> {
    let problem = match width - others {
        0 if others > 0 => "has times alone: add a column of samples for each axis".to_owned(),
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

/// Returns the columns of times, after a check that every other column can be an axis.
fn time_columns(names: &Header<'_>) -> Result<Vec<TimeColumn>> {
    // Checks that there is only one column of this name.
    names.exact_column(TIME_COLUMN)?;
    // If accelerations are named, a counter or a single quantity of the motion is left out, like other columns.
    let are_named = names.names().any(axes::is_acceleration);
    let motions = names.names().filter(|name| MOTION_COLUMNS.contains(name)).count();
    let mut times = Vec::new();
    for (index, name) in names.names().enumerate() {
        if let Some(time) = TimeColumn::named(index, name) {
            times.push(time);
            continue;
        }
        let (lower, stem) = (name.to_lowercase(), stem(name));
        let problem = if MOTION_COLUMNS.contains(&name) && (motions > 1 || !are_named) {
            format!(
                "has a column '{name}': a free hand's recordings are for 'stylus fit' or 'stylus page' with --strokes"
            )
        } else if TIME_WORDS.contains(&stem.as_str()) && lower != stem {
            format!(
                "has a column '{name}': name it 'time' or, with its unit, such as '{TIME_COLUMN}' or 'time_ms' if it \
                 is the time, or remove it"
            )
        } else if COUNTER_NAMES.contains(&stem.as_str()) && names.width() > 1 && !are_named {
            format!(
                "has a column '{name}', which is no acceleration: remove column {}",
                index + 1
            )
        } else if lower == "scale_m_s2" || lower == "file" || lower == "texture" {
            format!("has a column '{name}': is it a list of trials? Give it alone, and with speed_mm_s and force_n")
        } else {
            continue;
        };
        return Err(names.error(problem));
    }
    Ok(times)
}

/// Returns the first word of a column's name, in lower case.
fn stem(name: &str) -> String {
    name.to_lowercase()
        .split(['_', ' ', '[', '('])
        .next()
        .unwrap_or_default()
        .to_owned()
}

/// Refuses a header that contains numbers, or whose first field begins like a number.
fn refuse_numbers_in_header(header: &Row<'_, '_>, table: &CsvTable) -> Result<()> {
    let is_number = |field: &str| table.number(field).is_some();
    let Some((index, bad)) = header.fields().enumerate().find(|(_, field)| !is_number(field)) else {
        return Ok(());
    };
    if !header.fields().any(is_number) && !bad.starts_with(|c: char| c.is_ascii_digit() || c == '-') {
        return Ok(());
    }
    Err(header.error(format!(
        "'{bad}' in column {} is neither a number nor, beside numbers, a name ({}; decimal commas need another \
         separator)",
        index + 1,
        table.conventions()
    )))
}
