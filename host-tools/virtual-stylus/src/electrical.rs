//! Silicon, clocks and supply of a run, and the defects that the core notices.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use stylus_board::Board;

use crate::model::oscillators::Clocks;

/// REV_ID of revision V (section 60.5.8).
const REVISION_V: u16 = 0x2003;
/// BOR_LEV as it is set in a board's first hour; new parts have 0.
const SET_BROWN_OUT_LEVEL: u8 = 3;
/// Supply of a board, mV.
const RAIL_MILLIVOLTS: u32 = 3300;

/// Silicon, clocks and supply of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Electrical {
    /// The clocks.
    pub clocks: Clocks,
    /// REV_ID of the silicon (section 60.5.8).
    pub revision: u16,
    /// BOR_LEV of the option bytes, 0 to 3 (section 4.9.8).
    pub brown_out_level: u8,
    /// Supply, mV.
    pub supply_millivolts: u32,
}

impl Electrical {
    /// Silicon, clocks and supply of `board`.
    pub fn of(board: &Board) -> Self {
        Self {
            clocks: Clocks::of(board),
            revision: REVISION_V,
            brown_out_level: SET_BROWN_OUT_LEVEL,
            supply_millivolts: RAIL_MILLIVOLTS,
        }
    }
}

/// True if `revision` is Z or Y.
fn is_old(revision: u16) -> bool {
    revision < 0x2000
}

/// Differences of the converters between old silicon and revision V.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OldConverter {
    is_old: bool,
}

impl OldConverter {
    /// The converters of a part with this `revision`.
    pub fn of(revision: u16) -> Self {
        Self {
            is_old: is_old(revision),
        }
    }

    /// Returns the clock of a converter, given the rate `hz` that the emulator computes for revision V. Old silicon
    /// does not halve the clock (section 25.4.3).
    pub fn hz(self, hz: u64) -> u64 {
        if self.is_old { 2 * hz } else { hz }
    }

    /// Returns those of the `flags` of `ADC_ISR` that this silicon has: old silicon has no `LDORDY` (section 25.6.1).
    pub fn flags(self, flags: u64) -> u64 {
        const LDORDY: u64 = 1 << 12;
        if self.is_old { flags & !LDORDY } else { flags }
    }
}

/// An interrupt that the emulator's own models do not pass to the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interrupt {
    /// The non-maskable interrupt, of the clock security system.
    NonMaskable,
    /// `PVD_AVD`, of the voltage detector (table 148), whose line the emulator's EXTI lacks.
    Supply,
}

#[derive(Debug, Default)]
struct Shared {
    /// Requests that the core has not taken yet, in the order of [`Interrupt`].
    interrupts: [AtomicBool; 2],
    /// True if reads of the AXI SRAM are corrupted unless they are issued one at a time (ES0392 section 2.2.9).
    old_silicon: AtomicBool,
    one_read_at_a_time: AtomicBool,
}

/// Signals from the part to the core that do not use the bus. All clones share one state.
#[derive(Clone, Debug, Default)]
pub struct Defects(Arc<Shared>);

impl Defects {
    /// The defects of a part with this `revision`.
    pub fn of(revision: u16) -> Self {
        let defects = Self::default();
        let old = is_old(revision);
        defects.0.old_silicon.store(old, Ordering::Relaxed);
        defects
    }

    /// Requests an interrupt.
    pub fn interrupt(&self, which: Interrupt) {
        self.0.interrupts[which as usize].store(true, Ordering::Relaxed);
    }

    /// Clears the request of an interrupt, and returns true if there was one.
    pub fn take_interrupt(&self, which: Interrupt) -> bool {
        self.0.interrupts[which as usize].swap(false, Ordering::Relaxed)
    }

    /// Sets whether reads of the AXI SRAM are issued one at a time.
    pub fn issue_one_read(&self, one: bool) {
        self.0.one_read_at_a_time.store(one, Ordering::Relaxed);
    }

    /// True while reads of the AXI SRAM are corrupted.
    pub fn misreads(&self) -> bool {
        self.0.old_silicon.load(Ordering::Relaxed) && !self.0.one_read_at_a_time.load(Ordering::Relaxed)
    }
}
