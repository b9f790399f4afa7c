//! The record of a self test: a file with the device's identity, the date and all lines.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use model_format::link::DeviceInfo;
use serde::Serialize;
use stylus_support::Result;
use stylus_support::{atomic_file, date};

use super::line::{Line, Verdict};

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
