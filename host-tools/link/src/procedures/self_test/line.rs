//! Lines of a self test: a value, its limits, the verdict, and what to do; and the record of a test, a file with the
//! device's identity, the date and all lines.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use model_format::link::DeviceInfo;
use serde::Serialize;
use stylus_support::{Result, atomic_file, date};

/// Verdict on one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the limits.
    Pass,
    /// Outside the limits.
    Fail,
    /// Not measured, for the reason in the line.
    NotMeasured,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Pass => "pass",
            Self::Fail => "FAIL",
            Self::NotMeasured => "not measured",
        })
    }
}

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// What the line is about. A program may search for this name.
    pub name: String,
    /// The value as a number, where it is one.
    pub number: Option<f64>,
    /// The value in words, with its unit.
    pub value: String,
    /// The limits in words.
    pub limits: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Remedy, or how to have it measured; empty where the verdict is good.
    pub remedy: String,
}

impl Line {
    /// A number that must lie from `lowest` to `highest`, in `unit`, shown with `decimals`.
    pub fn number(
        name: impl Into<String>,
        value: f64,
        (lowest, highest): (f64, f64),
        (unit, decimals): (&str, usize),
        remedy: &str,
    ) -> Self {
        // A comparison with NaN is false.
        let good = value >= lowest && value <= highest;
        let text = |value: f64| format!("{value:.decimals$}");
        let limits = match (lowest.is_finite(), highest.is_finite()) {
            (true, true) if lowest == highest => text(highest),
            (true, true) => format!("{} to {}", text(lowest), text(highest)),
            (false, _) => format!("at most {}", text(highest)),
            (true, false) => format!("at least {}", text(lowest)),
        };
        let value_text = format!("{} {unit}", text(value)).trim_end().to_owned();
        let limits = format!("{limits} {unit}").trim_end().to_owned();
        Self {
            number: Some(value),
            ..Self::judged(name, value_text, limits, good, remedy)
        }
    }

    /// A count that must be zero.
    pub fn none(name: impl Into<String>, count: impl Into<u64>, remedy: &str) -> Self {
        Self::number(name, count.into() as f64, (0.0, 0.0), ("", 0), remedy)
    }

    /// A value that must be `expected`.
    pub fn exact(name: impl Into<String>, value: impl Into<String>, expected: impl Into<String>, remedy: &str) -> Self {
        let (value, expected) = (value.into(), expected.into());
        let good = value == expected;
        Self::judged(name, value, expected, good, remedy)
    }

    /// A value that the caller has compared with `limits`.
    pub fn judged(
        name: impl Into<String>,
        value: impl Into<String>,
        limits: impl Into<String>,
        good: bool,
        remedy: &str,
    ) -> Self {
        Self {
            name: name.into(),
            number: None,
            value: value.into(),
            limits: limits.into(),
            verdict: if good { Verdict::Pass } else { Verdict::Fail },
            remedy: if good { String::new() } else { remedy.to_owned() },
        }
    }

    /// Creates a line about something that was not measured. `why` says how to have it measured.
    pub fn not_measured(name: impl Into<String>, why: &str) -> Self {
        Self {
            name: name.into(),
            number: None,
            value: "-".to_owned(),
            limits: "-".to_owned(),
            verdict: Verdict::NotMeasured,
            remedy: why.to_owned(),
        }
    }
}

/// A self test with its device and its date.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Date and time of the test's end, UTC, as in 2026-11-22T08:15:00Z.
    pub date: String,
    /// Version of this program.
    pub host_version: &'static str,
    /// The device.
    pub device: DeviceInfo,
    /// Number of lines that pass.
    pub passed: usize,
    /// Number of lines that fail.
    pub failed: usize,
    /// Number of lines that were not measured.
    pub not_measured: usize,
    /// All lines.
    pub lines: Vec<Line>,
}

impl Record {
    /// The record of `lines`, which were measured now.
    pub fn new(device: &DeviceInfo, lines: Vec<Line>) -> Self {
        let count = |verdict| lines.iter().filter(|line| line.verdict == verdict).count();
        Self {
            date: date::utc(SystemTime::now()),
            host_version: env!("CARGO_PKG_VERSION"),
            device: device.clone(),
            passed: count(Verdict::Pass),
            failed: count(Verdict::Fail),
            not_measured: count(Verdict::NotMeasured),
            lines,
        }
    }

    /// Writes the record to `path`, or into the folder at `path` under a name with serial number and date. Returns the
    /// file's path.
    pub fn write(&self, path: &Path) -> Result<PathBuf> {
        let path = if path.is_dir() {
            path.join(self.file_name())
        } else {
            path.to_owned()
        };
        let mut text = serde_json::to_string_pretty(self).expect("records have text keys only");
        text.push('\n');
        atomic_file::write(&path, text.as_bytes())?;
        Ok(path)
    }

    /// Name of the record's file in a folder.
    fn file_name(&self) -> String {
        // No colons, which some file systems refuse.
        format!("selftest-{}-{}.json", self.device.serial, self.date.replace(':', ""))
    }
}
