//! Decisions at a start, by what was kept about earlier starts: safe mode, and the source of the clock.
//!
//! A fault within [`QUICK_FAULT_MS`] of a start is a quick fault. After [`QUICK_FAULTS`] quick faults in succession,
//! the device starts in safe mode. If a start hangs or fails while it sets up the clock, or the external clock fails
//! later, the next start uses a simpler clock. Power-on and the reset button clear this record, because a person is
//! present.

use model_format::link::{ClockSource, QUICK_FAULTS, StartStage};

#[cfg(doc)]
use model_format::link::QUICK_FAULT_MS;

/// Record of earlier starts that is kept over a reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Quick faults in succession.
    pub quick_faults: u8,
    /// True once this run has lasted [`QUICK_FAULT_MS`].
    pub healthy: bool,
    /// True if this start is in safe mode.
    pub safe_mode: bool,
    /// Best source of the clock that this start may use.
    pub clock: ClockSource,
    /// Stage under way; none once the start is over.
    pub stage: Option<StartStage>,
    /// Stage in which a start hung last since power-on or the reset button.
    pub hung_stage: Option<StartStage>,
}

/// End of the run before this start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Power came on, or the reset button or the probe pulled the reset pin.
    ByHand,
    /// The watchdog.
    ByWatchdog,
    /// A fault that was caught.
    ByFault {
        /// True if the fault was the failure of the external clock.
        clock_failed: bool,
    },
    /// Without a fault: a dip of the supply, or a reset that the program requested.
    WithoutFault,
}

impl Kept {
    /// Returns the record for the next start, after the run of this record has `ended`.
    #[must_use]
    pub fn next(self, ended: Ended) -> Self {
        if ended == Ended::ByHand {
            return Self::default();
        }
        let quick_faults = self.quick_faults_after(ended);
        let clock = self.clock_after(ended);
        let hung = (ended == Ended::ByWatchdog).then_some(self.stage).flatten();
        Self {
            quick_faults,
            healthy: false,
            // Without a multiplied clock there are no samples, so nothing can be played.
            safe_mode: self.safe_mode || quick_faults >= QUICK_FAULTS || clock == ClockSource::InternalUnmultiplied,
            clock,
            stage: None,
            hung_stage: hung.or(self.hung_stage),
        }
    }

    fn quick_faults_after(self, ended: Ended) -> u8 {
        let fault = ended != Ended::WithoutFault;
        match (self.healthy, fault) {
            (false, true) => self.quick_faults.saturating_add(1),
            // Safe mode stays, and so does the number of faults that is its reason.
            (true, _) if !self.safe_mode => 0,
            // A reset without a fault before the run was healthy proves nothing, so it clears nothing.
            _ => self.quick_faults,
        }
    }

    fn clock_after(self, ended: Ended) -> ClockSource {
        let failed = match ended {
            Ended::ByHand | Ended::WithoutFault => return self.clock,
            Ended::ByFault { clock_failed: true } => Some(StartStage::ExternalClock),
            Ended::ByWatchdog | Ended::ByFault { .. } => self.stage,
        };
        match failed {
            Some(StartStage::ExternalClock) => simpler(self.clock, ClockSource::Internal),
            Some(StartStage::InternalClock) => ClockSource::InternalUnmultiplied,
            _ => self.clock,
        }
    }

    /// Packs the record into one word, for memory that outlives a reset.
    pub const fn to_word(self) -> u32 {
        self.quick_faults as u32
            | (self.healthy as u32) << 8
            | (self.safe_mode as u32) << 9
            | (self.clock as u32) << 10
            | number(self.stage) << 12
            | number(self.hung_stage) << 16
    }

    /// Unpacks a word of [`Kept::to_word`].
    pub fn from_word(word: u32) -> Self {
        Self {
            quick_faults: word as u8,
            healthy: word >> 8 & 1 != 0,
            safe_mode: word >> 9 & 1 != 0,
            clock: match word >> 10 & 3 {
                0 => ClockSource::External,
                1 => ClockSource::Internal,
                _ => ClockSource::InternalUnmultiplied,
            },
            stage: numbered(word >> 12),
            hung_stage: numbered(word >> 16),
        }
    }
}

/// The simpler of two sources: the one further from the external clock.
const fn simpler(one: ClockSource, other: ClockSource) -> ClockSource {
    if one as u8 > other as u8 { one } else { other }
}

/// Number of a stage, from 1 on; 0 for none.
const fn number(stage: Option<StartStage>) -> u32 {
    match stage {
        Some(stage) => stage as u32 + 1,
        None => 0,
    }
}

fn numbered(number: u32) -> Option<StartStage> {
    let index = (number & 0xF).checked_sub(1)?;
    StartStage::ALL.get(index as usize).copied()
}
