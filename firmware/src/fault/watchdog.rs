//! The independent watchdog, RM0433 chapter 46: fed only while tick and executor both run.
//!
//! It has a clock of its own. A task feeds it, so an executor that hangs starves it. The task feeds only if the tick
//! has moved on, so a tick that hangs starves it too. The reset includes DAC and pins, and the start puts the output to
//! mid-scale.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac::IWDG1;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, peripherals};
use embassy_time::{Duration, Ticker};

use crate::fault::record;
use crate::tick::alive;

/// Timeout of the watchdog, µs.
const TIMEOUT_US: u32 = 250_000;

/// Interval between two feeds.
const FEED: Duration = Duration::from_millis(20);

/// Starts the watchdog. From then on nothing stops it; with the feature `debug-halt`, a debugger that halts the
/// processor does. The timers of the output go on in any case.
pub fn start(watchdog: Peri<'static, peripherals::IWDG1>) {
    #[cfg(feature = "debug-halt")]
    embassy_stm32::pac::DBGMCU
        .apb4fzr1()
        .modify(|w| w.set_iwdg1(true));
    IndependentWatchdog::new(watchdog, TIMEOUT_US).unleash();
}

/// Feeds the watchdog while the tick moves on.
#[embassy_executor::task]
pub async fn feed() -> ! {
    let mut ticker = Ticker::every(FEED);
    let mut before = alive::ended();
    loop {
        ticker.next().await;
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
}
