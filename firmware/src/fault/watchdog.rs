//! The independent watchdog, RM0433 chapter 45: fed only while tick and executor both run.
//!
//! The watchdog has its own clock. A task feeds it, so it bites if the executor hangs. The task feeds it only if the
//! tick has advanced, so it bites if the tick hangs, too. `boot/startup.rs` starts the watchdog with the first
//! instructions, and the start feeds it before and after it sets up the clocks. Once tasks run, the timeout is shorter.
//! The reset includes DAC and pins, and the next start puts the output to mid-scale.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::dbgmcu::regs::{Apb1lfzr1, Apb2fzr1};
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::pac::{DBGMCU, IWDG1};
use embassy_time::{Duration, Ticker};

use crate::boot::clock::CORE_HZ;
use crate::boot::startup;
use crate::fault::{record, stack};
use crate::tick::alive;

/// Interval between two feeds.
const FEED: Duration = Duration::from_millis(20);

/// True if the tick does not run, as in safe mode, so that the feeding does not depend on it.
static WITHOUT_TICK: AtomicBool = AtomicBool::new(false);

/// Cycle of the last feed.
static FED: AtomicU32 = AtomicU32::new(0);

/// Cycles of the longest time between two feeds. The counter wraps after ten seconds, long after the watchdog bites.
static LONGEST_GAP: AtomicU32 = AtomicU32::new(0);

/// Begins to measure the times between two feeds. The watchdog runs already.
pub fn start() {
    undo_debugger();
    FED.store(DWT::cycle_count(), Ordering::Relaxed);
}

/// Makes the watchdog and the timers of the output continue while a debugger halts the processor, and the cycle counter
/// continue in WFE. With the feature `debug-halt` the watchdog waits during a halt instead. Some debuggers set the
/// freeze bits when they connect (OpenOCD does so for the watchdogs), and some clear the other bits when they detach
/// (probe-rs). Only power-on resets these bits (RM0433 section 60.5.8), so they are written again at each feed.
fn undo_debugger() {
    DBGMCU.cr().modify(|w| {
        w.set_d1dbgcken(true);
        w.set_dbgsleep_d1(true);
    });
    DBGMCU.apb1lfzr1().write_value(Apb1lfzr1(0));
    DBGMCU.apb2fzr1().write_value(Apb2fzr1(0));
    DBGMCU.apb4fzr1().write(|w| w.set_iwdg1(cfg!(feature = "debug-halt")));
}

/// Makes the task feed the watchdog while the executor runs, even without ticks.
pub fn expect_no_tick() {
    WITHOUT_TICK.store(true, Ordering::Relaxed);
}

/// Feeds the watchdog while the tick advances, and searches the stack for its highest use, part by part. From the first
/// feed of this task on, the timeout is [`startup::RUNNING_WATCHDOG_US`].
#[embassy_executor::task]
pub async fn feed() -> ! {
    IWDG1.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG1
        .rlr()
        .write(|w| w.set_rl(startup::watchdog_reload(startup::RUNNING_WATCHDOG_US) as u16));
    let mut ticker = Ticker::every(FEED);
    let mut before = alive::ended();
    // What the start still does before its first wait comes before the first turn of this task. The time since the last
    // feed contains it, so that time is no gap between two feeds of this task.
    ticker.next().await;
    reload();
    LONGEST_GAP.store(0, Ordering::Relaxed);
    loop {
        ticker.next().await;
        undo_debugger();
        stack::search();
        let now = alive::ended();
        if now == before && !WITHOUT_TICK.load(Ordering::Relaxed) {
            record::note_tick_stopped();
        } else {
            reload();
        }
        before = now;
    }
}

/// Feeds the watchdog if the tick has advanced since the last call. For a wait during which no task runs.
#[inline(always)]
pub fn feed_while_ticking() {
    static BEFORE: AtomicU32 = AtomicU32::new(0);
    let now = alive::ended();
    if now != BEFORE.swap(now, Ordering::Relaxed) || WITHOUT_TICK.load(Ordering::Relaxed) {
        reload();
    }
}

/// Feeds the watchdog.
#[inline(always)]
pub fn reload() {
    IWDG1.kr().write(|w| w.set_key(Key::RESET));
    let now = DWT::cycle_count();
    let gap = now.wrapping_sub(FED.load(Ordering::Relaxed));
    FED.store(now, Ordering::Relaxed);
    if gap > LONGEST_GAP.load(Ordering::Relaxed) {
        LONGEST_GAP.store(gap, Ordering::Relaxed);
    }
}

/// Longest time between two feeds since tasks began to run, µs.
pub fn longest_gap_us() -> u32 {
    LONGEST_GAP.load(Ordering::Relaxed) / (CORE_HZ / 1_000_000)
}
