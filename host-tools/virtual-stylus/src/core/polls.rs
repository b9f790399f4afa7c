//! Loops that do nothing but poll a register, or wait by the cycle counter.

use rigless::emulator::{Access, AccessKind};

/// Number of polls in a row after which a loop waits for an event, and the most instructions between two polls in a
/// row.
const POLLS: u32 = 4;
const POLL_INSTRUCTIONS: u64 = 1024;
/// DWT_CYCCNT, the cycle counter by which a loop limits its wait (ARM DDI 0403E, C1.8.8).
const CYCLE_COUNT: u64 = 0xE000_1004;
/// The control of the oscillators, RCC_CR (section 8.7.2).
const OSCILLATORS: u64 = 0x5802_4400;
/// Number of reads in a row after which a waiting loop is shortened. Shorter loops run in full, so that they see the
/// edges of a tick to the cycle.
const WAITS: u32 = 4096;
/// Largest number of instructions between two reads of a waiting loop.
const WAIT_LOOP: u64 = 64;
/// Most instructions left out between two reads of a loop that is shortened: 3.2 µs of virtual time. A jump over all of
/// a stretch once passed a tick's trigger by 12 µs.
pub(super) const WAIT_INSTRUCTIONS: u32 = 640;

/// Reads in a row by a loop, with nothing else on the bus in between.
#[derive(Debug, Default)]
pub(super) struct Polls {
    /// Number of reads, by one instruction, of a register that only an event changes. Reads of the cycle counter
    /// neither add to it nor reset it.
    count: u32,
    program_counter: Option<u64>,
    at: u64,
    /// Number of reads of the cycle counter and of the oscillators' control.
    waits: u32,
    waited_at: u64,
}

impl Polls {
    /// Follows an access; `is_poll` is true for a read of a register that only an event changes.
    pub(super) fn follow(&mut self, access: &Access, is_poll: bool) {
        let is_read = access.kind == AccessKind::Read;
        let is_wait = is_read && [CYCLE_COUNT, OSCILLATORS].contains(&access.address);
        let waits_on = access.instruction_count - self.waited_at <= WAIT_LOOP;
        self.waits = match (is_wait, waits_on) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => self.waits + 1,
        };
        self.waited_at = access.instruction_count;
        // A loop may limit its polls by the cycle counter, so reads of the counter lie between two polls.
        if access.address == CYCLE_COUNT {
            return;
        }
        let goes_on =
            self.program_counter == access.program_counter && access.instruction_count - self.at <= POLL_INSTRUCTIONS;
        self.count = match (is_read && is_poll, goes_on) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => self.count + 1,
        };
        self.program_counter = access.program_counter;
        self.at = access.instruction_count;
    }

    /// Returns true if the core does nothing but poll or wait.
    pub(super) fn are_all(&self) -> bool {
        self.count >= POLLS || self.waits >= WAITS
    }

    /// Returns the number of instructions, at most `budget`, that can be left out because the core only polls or waits.
    pub(super) fn take(&mut self, budget: u32) -> Option<u32> {
        if !self.are_all() {
            return None;
        }
        let left_out = budget.min(WAIT_INSTRUCTIONS);
        // The next read of a wait shortens it again at once, so one turn of the loop is executed between two jumps. The
        // instructions left out count as executed, or the next read would seem too far from this one.
        *self = Self {
            waits: self.waits.min(WAITS - 1),
            waited_at: self.waited_at + u64::from(left_out),
            ..Self::default()
        };
        Some(left_out)
    }
}
