//! Signs of life of the tick, which the watchdog and the fault handlers read.
//!
//! The tick only writes them; it neither feeds the watchdog nor knows of it.
#![expect(unsafe_code, reason = "a place in memory that outlives a reset")]

use core::sync::atomic::{AtomicU32, Ordering};

/// Number of ticks that have ended, modulo 2³².
static ENDED: AtomicU32 = AtomicU32::new(0);

/// [`RUNNING_MARK`] while the tick runs. It survives a reset, so that a tick that never ends can be distinguished from
/// an executor that hangs.
#[unsafe(link_section = ".uninit.tick_running")]
static RUNNING: AtomicU32 = AtomicU32::new(0);

/// Value of [`RUNNING`] during a tick. After power-on the memory holds noise, which hardly ever equals this value.
const RUNNING_MARK: u32 = 0x5449_434B;

/// Notes that the tick begins.
#[inline(always)]
pub fn begin() {
    RUNNING.store(RUNNING_MARK, Ordering::Relaxed);
}

/// Notes that the tick has ended.
#[inline(always)]
pub fn end() {
    // The tick is the only writer, so load and store need not be one access.
    ENDED.store(ENDED.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    clear_running();
}

/// Number of ticks that have ended, modulo 2³². While it changes, the tick is alive.
#[inline(always)]
pub fn ended() -> u32 {
    ENDED.load(Ordering::Relaxed)
}

/// Sets the number of ticks that have ended, modulo 2³².
#[cfg(feature = "fault-injection")]
pub fn set_ended(ticks: u32) {
    ENDED.store(ticks, Ordering::Relaxed);
}

/// Reports whether a tick is running or, right after a reset, whether one was running at the reset.
pub fn is_running() -> bool {
    RUNNING.load(Ordering::Relaxed) == RUNNING_MARK
}

/// Clears what [`is_running`] reports, including a tick from before a reset.
#[inline(always)]
pub fn clear_running() {
    RUNNING.store(0, Ordering::Relaxed);
}
