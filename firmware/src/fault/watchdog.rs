//! The independent watchdog, RM0433 chapter 46: fed only while tick and executor both run.
//!
//! It has a clock of its own. A task feeds it, so an executor that hangs starves it. The task feeds only if the tick
//! has moved on, so a tick that hangs starves it too. The reset includes DAC and pins, and the start puts the output to
//! mid-scale.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::IWDG1;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, pac, peripherals};
use embassy_time::{Duration, Ticker};

use crate::boot::clock::CORE_HZ;
use crate::fault::{record, stack};
use crate::tick::alive;

/// Timeout of the watchdog, µs.
const TIMEOUT_US: u32 = 250_000;

/// Interval between two feeds.
const FEED: Duration = Duration::from_millis(20);

/// Cycle of the last feed.
static FED: AtomicU32 = AtomicU32::new(0);

/// Cycles of the longest time between two feeds. The counter wraps after ten seconds, and the watchdog bites long
/// before.
static LONGEST_GAP: AtomicU32 = AtomicU32::new(0);

/// Starts the watchdog. From then on only a debugger that halts the processor stops it.
pub fn start(watchdog: Peri<'static, peripherals::IWDG1>) {
    pac::DBGMCU.apb4fzr1().modify(|w| w.set_iwdg1(true));
    IndependentWatchdog::new(watchdog, TIMEOUT_US).unleash();
    FED.store(DWT::cycle_count(), Ordering::Relaxed);
}

/// Feeds the watchdog while the tick moves on, and searches the stack for its most use, piece by piece.
#[embassy_executor::task]
pub async fn feed() -> ! {
    let mut ticker = Ticker::every(FEED);
    let mut before = alive::ended();
    loop {
        ticker.next().await;
        stack::search();
        let now = alive::ended();
        if now == before {
            record::note_tick_stopped();
        } else {
            reload();
        }
        before = now;
    }
}

/// Feeds the watchdog if the tick has moved on since the last call, for a wait during which no task runs.
#[inline(always)]
pub fn feed_while_ticking() {
    static BEFORE: AtomicU32 = AtomicU32::new(0);
    let now = alive::ended();
    if now != BEFORE.swap(now, Ordering::Relaxed) {
        reload();
    }
}

#[inline(always)]
fn reload() {
    IWDG1.kr().write(|w| w.set_key(Key::RESET));
    let now = DWT::cycle_count();
    let gap = now.wrapping_sub(FED.load(Ordering::Relaxed));
    FED.store(now, Ordering::Relaxed);
    if gap > LONGEST_GAP.load(Ordering::Relaxed) {
        LONGEST_GAP.store(gap, Ordering::Relaxed);
    }
}

/// Longest time between two feeds since the start, µs.
pub fn longest_gap_us() -> u32 {
    LONGEST_GAP.load(Ordering::Relaxed) / (CORE_HZ / 1_000_000)
}
