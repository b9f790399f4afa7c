//! Cycles of tick and update, by the device's own cycle counter, for every texture and scene of the suite.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use model_format::link::{CycleReport, MotionSource, Selection};
use stylus_costs::cycles::{CycleRow, MeasuredCycles, MeasuredDevice};

use crate::bench::Bench;
use crate::error::{Error, Result};

/// Time before a measurement, ms of the device: a direct form of order 400 is run up for 92 ms.
const RUN_UP_MS: u64 = 200;

/// Updates per second.
const UPDATES_HZ: u32 = 500;

/// Ticks per second.
const TICKS_HZ: u32 = 5_000;

/// Measures the idle device and `selections`, and returns the table.
///
/// # Errors
/// The link fails, or the device refuses to play.
pub fn check(bench: &mut Bench, selections: &[(String, Selection)]) -> Result<MeasuredCycles> {
    let mut rows = Vec::new();
    bench.device.take_cycles()?;
    bench.wait(bench.lengths.play_ms)?;
    let idle = bench.device.take_cycles()?;
    add(bench, &mut rows, "idle", idle);
    for (what, selection) in selections {
        let length = bench.lengths.play_ms;
        let measured = bench.while_playing(selection, MotionSource::Host, |bench| {
            bench.wait_until_heard()?;
            bench.wait(RUN_UP_MS)?;
            bench.device.take_cycles()?;
            bench.wait(length)?;
            Ok(bench.device.take_cycles()?)
        });
        let (report, _) = measured?;
        add(bench, &mut rows, what, report);
    }
    let revision = bench.status()?.start.revision.to_string();
    let info = bench.device.info();
    let device = MeasuredDevice {
        serial: info.serial.to_string(),
        emulated: bench.is_emulated(),
        revision,
        core_hz: idle.core_hz,
        firmware_version: info.firmware_version.to_string(),
        build: info.build.to_string(),
        date: today(),
    };
    Ok(MeasuredCycles { device, rows })
}

/// Adds a row, and its line: the tick must end within its period, and the update within its own.
fn add(bench: &mut Bench, rows: &mut Vec<CycleRow>, what: &str, report: CycleReport) {
    let CycleReport {
        core_hz,
        tick,
        update,
    } = report;
    let emulated = if bench.is_emulated() {
        ", emulated"
    } else {
        ""
    };
    bench.judge(
        what,
        format!(
            "tick {} to {}, update {} to {} cycles{emulated}",
            tick.shortest, tick.longest, update.shortest, update.longest
        ),
        &format!(
            "tick {}, update {}",
            core_hz / TICKS_HZ,
            core_hz / UPDATES_HZ
        ),
        tick.runs > 0
            && update.runs > 0
            && tick.longest < core_hz / TICKS_HZ
            && update.longest < core_hz / UPDATES_HZ,
    );
    rows.push(CycleRow {
        what: what.to_owned(),
        ticks: tick.runs,
        tick_shortest: tick.shortest,
        tick_longest: tick.longest,
        updates: update.runs,
        update_shortest: update.shortest,
        update_longest: update.longest,
    });
}

/// Writes `measured` to `path`.
///
/// # Errors
/// The file cannot be written.
pub fn write(measured: &MeasuredCycles, path: &Path) -> Result<()> {
    let text = serde_json::to_string_pretty(measured).expect("plain data") + "\n";
    std::fs::write(path, text).map_err(|source| Error::File {
        path: path.to_owned(),
        source,
    })
}

/// The day, UTC.
fn today() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    date(since.map_or(0, |since| since.as_secs() / 86_400))
}

/// The day `days` after 1970-01-01, in the Gregorian calendar.
fn date(mut days: u64) -> String {
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    loop {
        let length = if is_leap(year) { 366 } else { 365 };
        if days < length {
            break;
        }
        days -= length;
        year += 1;
    }
    let february = if is_leap(year) { 29 } else { 28 };
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    format!("{year:04}-{month:02}-{:02}", days + 1)
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn a_day_is_written_as_the_calendar_has_it() {
        for (days, text) in [
            (0, "1970-01-01"),
            (58, "1970-02-28"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (11_017, "2000-03-01"),
            (20_453, "2025-12-31"),
            (20_454, "2026-01-01"),
        ] {
            assert_eq!(date(days), text);
        }
    }
}
