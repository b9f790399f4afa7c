//! Durations of tick and update, in cycles of the processor.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Range of the durations of one handler's runs, from its entry to its exit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct CycleRange {
    /// Number of runs.
    pub runs: u32,
    /// Shortest run, cycles; all ones without a run.
    pub shortest: u32,
    /// Longest run, cycles; 0 without a run.
    pub longest: u32,
}

impl CycleRange {
    /// The range of no runs.
    pub const NONE: Self = Self {
        runs: 0,
        shortest: u32::MAX,
        longest: 0,
    };

    /// The range of the runs of both.
    #[must_use]
    pub fn merged(self, other: Self) -> Self {
        Self {
            runs: self.runs.saturating_add(other.runs),
            shortest: self.shortest.min(other.shortest),
            longest: self.longest.max(other.longest),
        }
    }
}

/// Durations since the request before, or since the start. Each request begins a new range, so that a host can measure
/// what it plays, one texture or scene after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct CycleReport {
    /// Clock of the processor, Hz.
    pub core_hz: u32,
    /// The tick.
    pub tick: CycleRange,
    /// The update, with the ticks and the serial port's interrupts that interrupted it.
    pub update: CycleRange,
}
