//! LabVIEW's measurement files (`.lvm`), as tables.
//!
//! Source: National Instruments, Specification for the LabVIEW Measurement File (.lvm). A header of keys ends with
//! `***End_of_Header***`, and so does the header of each block of data below it. A line of labels follows, and then
//! rows with samples, x values and a comment. There is one column of x values, none, or one before each channel.
//!
//! The table contains all lines of the file. Lines that are not data become comments, so that errors name the lines of
//! the file.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, check_length};
use stylus_support::{Error, Result};

use super::defects::Truncation;
use super::rate::MAX_CHANNELS;

/// First words of a file.
const MAGIC: &str = "LabVIEW Measurement";

/// End of a header.
const END: &str = "***End_of_Header***";

/// Keys whose values are used. Others are not kept, however many a file has.
const KEYS: [&str; 4] = ["Channels", "Samples", "Delta_X", "Y_Unit_Label"];

/// Largest relative deviation of two steps of times that count as equal.
const SAME_STEP: f64 = 1e-3;

/// Largest difference of two channels' times, as a fraction of their step.
const SAME_TIME: f64 = 0.1;

/// A file as a table.
#[derive(Debug)]
pub(super) struct LabView {
    /// A column of times, if the file has times, and one column for each channel, with its unit.
    pub table: CsvTable,
    /// Sample rate stated in the header, Hz.
    pub rate_hz: Option<f64>,
    /// Lengths, if there are fewer rows than the headers state.
    pub truncation: Option<Truncation>,
    /// Changes of the times, in words.
    pub remarks: Vec<String>,
}

/// The columns of x values.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Times {
    No,
    One,
    PerChannel,
}

/// Returns whether the file at `path` is a LabVIEW file.
pub(super) fn is_lvm(path: &Path) -> Result<bool> {
    let mut beginning = Vec::new();
    let read = (Format::LabView.open(path)?).take(64).read_to_end(&mut beginning);
    read.map_err(Error::io("read", path))?;
    Ok(beginning
        .strip_prefix(b"\xef\xbb\xbf")
        .unwrap_or(&beginning)
        .starts_with(MAGIC.as_bytes()))
}

/// Reads the file at `path`.
///
/// # Errors
/// The file cannot be read or has no rows; there are too many channels; a field is not a number; steps of times or
/// numbers of channels differ between headers; or channels have different times.
pub(super) fn read(path: &Path) -> Result<LabView> {
    let bytes = Format::LabView.read(path)?;
    // Units are often in the Western European code page.
    let text = String::from_utf8(bytes)
        .unwrap_or_else(|failure| failure.as_bytes().iter().map(|&byte| char::from(byte)).collect());
    let mut reader = Reader::of(path, &text);
    for (line, number) in text.lines().zip(1..) {
        check_length(path, number, line.len())?;
        let own = reader.line(line, number)?;
        // Lines that are not data become comments, so that line numbers stay the same.
        reader.table.push_str(own.as_deref().unwrap_or("#"));
        reader.table.push('\n');
    }
    reader.finished()
}

/// The part of the file that a line is in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Head,
    Labels,
    FirstRow,
    Rows,
    Special,
}

/// A file that is read line by line.
struct Reader<'a> {
    path: &'a Path,
    separator: char,
    times: Times,
    state: State,
    /// Fields after each of [`KEYS`], in the latest header that has it.
    keys: HashMap<&'a str, Vec<&'a str>>,
    /// Channels of the first block.
    channels: Option<usize>,
    /// Step of the times from the first header that states one, s.
    step_s: Option<f64>,
    /// Offset that is added to the times after blocks that started again, s.
    offset_s: f64,
    last_s: Option<f64>,
    blocks: usize,
    are_joined: bool,
    /// Number of samples per channel that the headers declare; `held` is the number that was read.
    declared: u64,
    held: u64,
    table: String,
}

impl<'a> Reader<'a> {
    /// Creates a reader at the beginning of the file with this `text`, using the keys of its first header.
    fn of(path: &'a Path, text: &str) -> Self {
        // The separator and the kind of times must be known before the first line is divided.
        let value = |key: &str| {
            let mut head = text.lines().take_while(|line| !line.starts_with(END));
            let line = head.find(|line| line.starts_with(key))?;
            let value = line.get(key.len() + 1..)?;
            Some(value.trim_matches([',', '\t', ' ']).to_lowercase())
        };
        let separator = match value("Separator").as_deref() {
            Some("comma") => ',',
            _ => '\t',
        };
        let times = match value("X_Columns").as_deref() {
            Some("no") => Times::No,
            Some("multi") => Times::PerChannel,
            _ => Times::One,
        };
        Self {
            path,
            separator,
            times,
            state: State::Head,
            keys: HashMap::new(),
            channels: None,
            step_s: None,
            offset_s: 0.0,
            last_s: None,
            blocks: 0,
            are_joined: false,
            declared: 0,
            held: 0,
            table: String::new(),
        }
    }

    /// Returns the line of the table for the next line of the file; `None` for a line that is not data.
    fn line(&mut self, line: &'a str, number: u64) -> Result<Option<String>> {
        let fields: Vec<&str> = line.split(self.separator).map(str::trim).collect();
        let is_empty = fields.iter().all(|field| field.is_empty());
        match self.state {
            State::Special if fields[0] == "***End_Special***" => self.state = State::Rows,
            State::Head if fields[0] == END => self.end_head(number)?,
            State::Head => self.keep(&fields),
            State::Labels if !is_empty => {
                self.state = State::FirstRow;
                return self.labels(&fields, number);
            }
            State::FirstRow | State::Rows if fields[0] == "***Start_Special***" => {
                self.state = State::Special;
            }
            State::FirstRow | State::Rows if is_key(fields[0]) => {
                self.state = State::Head;
                self.keep(&fields);
            }
            State::FirstRow | State::Rows if !is_empty => return self.row(&fields, number),
            _ => {}
        }
        Ok(None)
    }

    /// Keeps the fields of a line of a header, if its key is used.
    fn keep(&mut self, fields: &[&'a str]) {
        if KEYS.contains(&fields[0]) {
            self.keys.insert(fields[0], fields[1..].to_vec());
        }
    }

    /// Returns the fields of `key` in the latest header that has this key.
    fn of_key(&self, key: &str) -> &[&'a str] {
        self.keys.get(key).map_or(&[], Vec::as_slice)
    }

    /// Ends a header. The header of a block, unlike that of the file, states its channels.
    fn end_head(&mut self, line: u64) -> Result<()> {
        if self.of_key("Channels").is_empty() {
            return Ok(());
        }
        self.state = State::Labels;
        self.blocks += 1;
        let samples = (self.of_key("Samples").first()).map_or(0, |count| count.parse().unwrap_or(0));
        self.declared = self.declared.saturating_add(samples);
        for step in self
            .of_key("Delta_X")
            .iter()
            .filter_map(|field| number(field))
            .filter(|step| *step > 0.0)
            .collect::<Vec<f64>>()
        {
            if (step / *self.step_s.get_or_insert(step) - 1.0).abs() > SAME_STEP {
                let problem = "Delta_X has several values: write channels of one sample rate to a file";
                return Err(Error::line(self.path, line, problem));
            }
        }
        Ok(())
    }

    /// Returns the header of the table, from the labels of the first block.
    fn labels(&mut self, fields: &[&str], line: u64) -> Result<Option<String>> {
        let labels: Vec<&str> = fields
            .iter()
            .filter(|label| !["X_Value", "Comment", ""].contains(label))
            .copied()
            .collect();
        let count = self.of_key("Channels")[0].parse().unwrap_or(labels.len());
        let problem = match self.channels {
            _ if count == 0 || count > MAX_CHANNELS => {
                format!("{count} channels: give 1 to {MAX_CHANNELS}, one per axis")
            }
            Some(before) if before != count => {
                format!("a block of {count} channels, where the first has {before}: divide the file")
            }
            // The first block has given the table its header.
            Some(_) => return Ok(None),
            None => {
                self.channels = Some(count);
                let units = self.of_key("Y_Unit_Label");
                let names = (0..count).map(|index| {
                    let name = labels.get(index).map_or("", |name| *name);
                    // In the table, these signs separate fields, quote them or begin a comment.
                    let name = name.replace([';', ',', '"', '#'], " ");
                    let unit = units.get(index).copied().unwrap_or_default();
                    format!("channel {} {name} [{unit}]", index + 1)
                });
                let time = (self.times != Times::No).then(|| "time_s".to_owned());
                return Ok(Some(time.into_iter().chain(names).collect::<Vec<_>>().join(";")));
            }
        };
        Err(Error::line(self.path, line, problem))
    }

    /// Returns the time, if the file has times, and a sample of each channel.
    fn row(&mut self, fields: &[&str], line: u64) -> Result<Option<String>> {
        let count = self.channels.unwrap_or(1);
        let (times, samples): (Vec<usize>, Vec<usize>) = match self.times {
            // An empty column in place of the times may be present.
            Times::No => {
                let first = usize::from(fields[0].is_empty());
                (Vec::new(), (first..first + count).collect())
            }
            Times::One => (vec![0], (1..=count).collect()),
            // Each channel has its times in the column before it.
            Times::PerChannel => (0..2 * count).partition(|index| index % 2 == 0),
        };
        let field = |index: usize| fields.get(index).copied().unwrap_or_default();
        // If a channel ends earlier than the others, the table ends there.
        if self.times == Times::PerChannel && samples.iter().any(|&index| field(index).is_empty()) {
            return Ok(None);
        }
        let values = |indices: Vec<usize>| {
            let value = |index: usize| {
                let problem = || format!("'{}' in column {} is not a number", field(index), index + 1);
                number(field(index)).ok_or_else(|| Error::line(self.path, line, problem()))
            };
            indices.into_iter().map(value).collect::<Result<Vec<f64>>>()
        };
        let (times, samples) = (values(times)?, values(samples)?);
        if let (Some(first), Some(step)) = (times.first(), self.step_s)
            && times.iter().any(|time| (time - first).abs() > SAME_TIME * step)
        {
            let problem = "the channels' times differ: write them with one column of times";
            return Err(Error::line(self.path, line, problem));
        }
        self.held += 1;
        // `risen` must still see whether this row is the first of its block.
        let time = times.first().map(|&time| self.risen(time));
        self.state = State::Rows;
        // With an exponent, because a short number such as 1e300 has hundreds of digits without.
        let all = time.iter().chain(&samples).map(|value| format!("{value:?}"));
        Ok(Some(all.collect::<Vec<_>>().join(";")))
    }

    /// Returns the time of a row. If the times of a block start again, they continue from the previous block.
    fn risen(&mut self, time_s: f64) -> f64 {
        if let (State::FirstRow, Some(last), Some(step)) = (self.state, self.last_s, self.step_s)
            && time_s + self.offset_s <= last
        {
            self.offset_s = last + step - time_s;
            self.are_joined = true;
        }
        let risen = time_s + self.offset_s;
        self.last_s = Some(risen);
        risen
    }

    /// Returns the complete table.
    fn finished(self) -> Result<LabView> {
        if self.held == 0 {
            let problem = format!("has no rows below a line '{END}': write it again");
            return Err(Error::file(self.path, problem));
        }
        // Without times, nothing shows how much time passed between blocks.
        let is_joined = self.are_joined || (self.times == Times::No && self.blocks > 1);
        let joined =
            is_joined.then(|| "its blocks are joined end to end, because the times of each begin anew".to_owned());
        let (declared, held) = (self.declared, self.held);
        Ok(LabView {
            table: CsvTable::of(self.path, self.table)?,
            rate_hz: self.step_s.map(|step| 1.0 / step),
            truncation: (held < declared).then_some(Truncation { declared, held }),
            remarks: joined.into_iter().collect(),
        })
    }
}

/// Returns whether the first field of a line below data is the key of another header.
fn is_key(field: &str) -> bool {
    field.starts_with(|first: char| first.is_ascii_alphabetic()) && number(field).is_none()
}

/// Parses a number with a decimal point or comma.
fn number(field: &str) -> Option<f64> {
    if field.contains('.') {
        field.parse().ok()
    } else {
        field.replacen(',', ".", 1).parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Trial;
    use crate::recording::csv_file::read_table;
    use crate::recording::trial::{Cut, Source};
    use test_helpers::{holds, new_file};

    const HEAD: &str = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n\
                        Multi_Headings\tYes\n";

    /// Samples of two axes that differ everywhere.
    fn sample(row: usize, axis: usize) -> f64 {
        ((row * 7 + axis * 3) % 11) as f64 / 8.0 - 0.5
    }

    /// A block with its header: rows from the beginning of `rows`, with x values from `begin_s` on.
    fn block(kind: &str, rows: std::ops::Range<usize>, begin_s: f64) -> String {
        let count = rows.len();
        let mut text = format!(
            "Channels\t2\nSamples\t{count}\t{count}\nY_Unit_Label\tg\tm/s^2\nX_Dimension\tTime\tTime\nX0\t0\t0\n\
             Delta_X\t0.001\t0.001\n{END}\t\t\n"
        );
        text += match kind {
            "Multi" => "X_Value\tax\tX_Value\tay\tComment\n",
            _ => "X_Value\tax\tay\tComment\n",
        };
        for (index, row) in rows.enumerate() {
            let time = begin_s + index as f64 / 1000.0;
            let [a, b] = [sample(row, 0), sample(row, 1)];
            text += &match kind {
                "No" => format!("\t{a}\t{b}\n"),
                "Multi" => format!("{time:.6}\t{a}\t{time:.6}\t{b}\n"),
                _ => format!("{time:.6}\t{a}\t{b}\n"),
            };
        }
        text + "\n"
    }

    fn read_text(text: &[u8]) -> Result<(Source, LabView)> {
        let (_folder, path) = new_file("a.lvm");
        std::fs::write(&path, text).unwrap();
        let own = read(&path)?;
        let trial = Trial::of(path, "felt", 100.0, 1.0);
        Ok((read_table(&own.table, &trial, own.rate_hz, &Cut::WHOLE)?, own))
    }

    #[test]
    fn files_of_every_form_hold_the_same_samples() {
        for kind in ["One", "No", "Multi"] {
            let head = format!("{HEAD}X_Columns\t{kind}\n{END}\t\n\n");
            let whole = head.clone() + &block(kind, 0..300, 0.0);
            let several = |begin_s: f64| {
                let second = block(kind, 100..300, begin_s);
                format!("{head}{}{second}", block(kind, 0..100, 0.0))
            };
            let special = whole.clone() + "***Start_Special***\nSETTINGS\tx\n***End_Special***\n";
            let commas = whole.replace('\t', ",").replace("Tab", "Comma");
            let decimal_commas = whole.replace('.', ",");
            for text in [&whole, &several(0.1), &several(0.0), &special, &commas, &decimal_commas] {
                let (source, own) = read_text(text.as_bytes()).unwrap();
                assert!((source.rate.hz() - 1000.0).abs() < 1e-6, "{kind}");
                for axis in 0..2 {
                    let expected: Vec<f64> = (0..300).map(|row| sample(row, axis)).collect();
                    assert_eq!(source.channels[axis], expected, "{kind}");
                }
                assert_eq!(source.stated.scales_m_s2, Some(vec![9.80665, 1.0]), "{kind}");
                let is_joined = text == &several(0.0) || (kind == "No" && text == &several(0.1));
                assert_eq!(!own.remarks.is_empty(), is_joined, "{kind}");
                assert_eq!(own.truncation, None);
            }
        }
    }

    #[test]
    fn units_in_latin_1_are_read_and_lost_rows_are_told() {
        let head = format!("{HEAD}X_Columns\tOne\n{END}\t\n\n");
        let text = head + &block("One", 0..300, 0.0).replace("m/s^2", "m/s\u{b2}");
        let latin: Vec<u8> = text.chars().map(|sign| sign as u32 as u8).collect();
        let (source, _) = read_text(&latin).unwrap();
        assert_eq!(source.stated.units, "g, m/s²");
        let cut = text.lines().count() - 101;
        let cut: Vec<&str> = text.lines().take(cut).collect();
        let (_, own) = read_text(cut.join("\n").as_bytes()).unwrap();
        assert_eq!(
            own.truncation,
            Some(Truncation {
                declared: 300,
                held: 200
            })
        );
    }

    /// Counts what is kept, because a search among all keys of a file takes as long as their square.
    #[test]
    fn keys_that_are_not_used_are_not_kept_and_counts_that_no_file_has_do_not_overflow() {
        let mut reader = Reader::of(Path::new("a.lvm"), "");
        let block = format!(
            "Channels\t1\nSamples\t{}\nDelta_X\t0.001\n{END}\nX_Value\tx\n0\t1\n",
            u64::MAX
        );
        let keys = (0..1000).fold(String::new(), |keys, n| keys + &format!("Key{n}\tx\n"));
        let text = format!("{keys}{block}").repeat(3);
        for (line, number) in text.lines().zip(1..) {
            reader.line(line, number).unwrap();
            assert!(reader.keys.len() <= KEYS.len());
        }
        assert_eq!((reader.blocks, reader.declared), (3, u64::MAX));
    }

    #[test]
    fn rates_lines_and_numbers_have_the_bounds_of_other_tables() {
        let head = format!("{HEAD}X_Columns\tNo\n{END}\t\n\n");
        let whole = head + &block("No", 0..300, 0.0);
        for step in ["1e-300", "1e-8", "0.1"] {
            let text = whole.replace("Delta_X\t0.001\t0.001", &format!("Delta_X\t{step}\t{step}"));
            holds(
                &read_text(text.as_bytes()).unwrap_err(),
                &["sample rate of", "--sample-rate"],
            );
        }
        let tabs = whole.clone() + &"\t".repeat(3 << 20);
        holds(&read_text(tabs.as_bytes()).unwrap_err(), &["a row of more than"]);
        // A number of five characters takes no hundreds of them.
        let mut reader = Reader::of(Path::new("a.lvm"), "X_Columns\tNo\n");
        let row = reader.row(&["1e300"], 1).unwrap().unwrap();
        assert_eq!(row, "1e300");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let head = format!("{HEAD}X_Columns\tOne\n{END}\t\n\n");
        let whole = head.clone() + &block("One", 0..20, 0.0);
        let rows_begin = whole.lines().position(|line| line.starts_with("X_Value")).unwrap() + 2;
        let broken = whole.replace("0.005000\t", "0.005000\t1x");
        let line = format!("line {}", rows_begin + 5);
        for (text, words) in [
            (broken, &[line.as_str(), "column 2", "1x"][..]),
            (whole.replace("Channels\t2", "Channels\t4"), &["4 channels"]),
            (
                whole.replace("Delta_X\t0.001\t0.001", "Delta_X\t0.001\t0.002"),
                &["Delta_X"],
            ),
            (head, &["no rows"]),
            (HEAD.to_owned(), &["no rows"]),
        ] {
            holds(&read_text(text.as_bytes()).unwrap_err(), words);
        }
    }
}
