//! The record of a self test: a file with the device's identity, the date and all lines.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use model_format::link::DeviceInfo;
use serde::Serialize;

use super::line::{Line, Verdict};
use crate::support::atomic_file;
use crate::support::error::Result;

/// A self test with its device and its date.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Date and time of its end, UTC, as in 2026-11-22T08:15:00Z.
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
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            date: date(now.unwrap_or_default()),
            host_version: env!("CARGO_PKG_VERSION"),
            device: device.clone(),
            passed: count(Verdict::Pass),
            failed: count(Verdict::Fail),
            not_measured: count(Verdict::NotMeasured),
            lines,
        }
    }

    /// Writes it to `path`, or into the folder at `path` under a name with serial number and date. Returns its path.
    ///
    /// # Errors
    /// The file cannot be written.
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

    /// Name of its file in a folder.
    fn file_name(&self) -> String {
        // No colons, which some file systems refuse.
        format!(
            "selftest-{}-{}.json",
            self.device.serial,
            self.date.replace(':', "")
        )
    }
}

/// Date and time `since` 1970, UTC, in the proleptic Gregorian calendar.
fn date(since: Duration) -> String {
    let seconds = since.as_secs();
    let (mut days, of_day) = (seconds / 86_400, seconds % 86_400);
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    let (hour, minute, second) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!(
        "{year:04}-{month:02}-{:02}T{hour:02}:{minute:02}:{second:02}Z",
        days + 1
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(date(Duration::from_secs(seconds)), expected);
        }
    }
}
