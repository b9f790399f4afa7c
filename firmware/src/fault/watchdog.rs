//! The independent watchdog, RM0433 chapter 46: fed only while tick and executor both live.
//!
//! It has a clock of its own. One task feeds it, so a hanging executor starves it; the task looks whether the tick has
//! moved on, so a hanging tick does. The reset takes DAC and pins with it, and the start puts the output to mid-scale.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac::IWDG1;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, pac, peripherals};
use embassy_time::{Duration, Ticker};

use crate::fault::record;
use crate::tick::alive;

/// How long the watchdog waits, µs.
const TIMEOUT_US: u32 = 250_000;

/// How often it is fed.
const FEED: Duration = Duration::from_millis(20);

/// Starts the watchdog; from now on nothing stops it. A halted processor of a debugger's does, so that it can be looked at.
pub fn start(watchdog: Peri<'static, peripherals::IWDG1>) {
    pac::DBGMCU.apb4fzr1().modify(|w| w.set_iwdg1(true));
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

/// For a wait that lets no task run: feeds if the tick has moved on since the last call.
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
