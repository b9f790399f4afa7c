//! Counts instructions with the timer.
//!
//! With `-icount shift=8` QEMU advances virtual time by 256 ns per instruction. SysTick runs at 25 MHz on the MPS2
//! board, 6.4 ticks per instruction, so a count is exact although a tick may be lost at its beginning and at its end.

use core::fmt;
use core::hint::black_box;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// The largest count of SysTick, which counts down in 24 bits.
const MASK: u32 = 0x00ff_ffff;

/// Counts the instructions of calls.
pub struct Counter {
    /// The cost of reading the timer and making an empty call, ticks.
    empty_ticks: u32,
}

impl Counter {
    /// Starts the timer, and measures the cost of counting itself.
    pub fn new(mut systick: SYST) -> Self {
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(MASK);
        systick.clear_current();
        systick.enable_counter();
        Self {
            empty_ticks: ticks(&mut || ()),
        }
    }

    /// Returns the number of instructions of `call` beyond those of an empty call. It must be below 2.6 million.
    pub fn instructions(&self, call: &mut dyn FnMut()) -> u32 {
        let ticks = ticks(call) - self.empty_ticks;
        // 32 ticks correspond to 5 instructions.
        (ticks * 5 + 16) / 32
    }
}

/// Returns the ticks of `call`, including those of counting. All calls share this function, so the cost of counting is
/// the same for each.
#[inline(never)]
fn ticks(call: &mut dyn FnMut()) -> u32 {
    let before = SYST::get_current();
    black_box(call)();
    before.wrapping_sub(SYST::get_current()) & MASK
}

/// The smallest and the largest of several counts.
pub struct Range {
    fewest: u32,
    most: u32,
    count: u32,
}

impl Default for Range {
    fn default() -> Self {
        Self {
            fewest: u32::MAX,
            most: 0,
            count: 0,
        }
    }
}

impl Range {
    pub fn add(&mut self, value: u32) {
        self.fewest = self.fewest.min(value);
        self.most = self.most.max(value);
        self.count += 1;
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.fewest, self.most, self.count)
    }
}
