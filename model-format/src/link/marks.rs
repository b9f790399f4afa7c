//! Marks: the worst that the device has seen of itself since its start.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Worst cases since the start. Cycles are those of the processor, see [`super::TickHistogram::core_hz`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Marks {
    /// Length of the stack, bytes.
    pub stack_bytes: u32,
    /// Bytes of the stack that were ever used, by tasks and interrupts together. It may be a second old.
    pub stack_used_bytes: u32,
    /// Longest delay from the timer's trigger to the first instruction of the tick, cycles. A tick that was missed is
    /// counted as missed and is not in here.
    pub longest_tick_delay_cycles: u32,
    /// Longest time that interrupts were masked since the tick runs, cycles.
    pub longest_critical_section_cycles: u32,
    /// Longest time between two feeds of the watchdog, µs.
    pub longest_watchdog_gap_us: u32,
}
