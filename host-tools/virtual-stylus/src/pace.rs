//! Compares the virtual stylus's pace with the wall clock.

use std::time::Duration;

/// Real time over which the pace is measured.
const INTERVAL: Duration = Duration::from_secs(10);

/// Ratio of virtual to real time below which commands take noticeably longer.
const SLOW: f64 = 0.5;

/// Intervals of a slow run between two reports.
const QUIET_INTERVALS: u32 = 6;

/// Watches how much virtual time passes per real time.
#[derive(Debug, Default)]
pub struct Pace {
    /// Real and virtual time at the beginning of the interval.
    since: (Duration, Duration),
    /// Number of slow intervals that are still to pass without a report.
    quiet: u32,
}

impl Pace {
    /// Returns the ratio of virtual to real time over the last interval, if the ratio is below [`SLOW`]. After such a
    /// report, the next `QUIET_INTERVALS - 1` slow intervals are not reported. `real` and `of_stylus` are the real and
    /// the virtual time since the run began.
    pub fn slow(&mut self, real: Duration, of_stylus: Duration) -> Option<f64> {
        let (since, before) = self.since;
        let passed = real.saturating_sub(since);
        if passed < INTERVAL {
            return None;
        }
        self.since = (real, of_stylus);
        let share = of_stylus.saturating_sub(before).as_secs_f64() / passed.as_secs_f64();
        if share >= SLOW {
            return None;
        }
        if self.quiet > 0 {
            self.quiet -= 1;
            return None;
        }
        self.quiet = QUIET_INTERVALS - 1;
        Some(share)
    }
}
