//! The beginning of embassy's clock.
//!
//! The driver of embassy-stm32 0.6 counts half turns of TIM2's 16 bits by two flags: update, and compare of channel 1
//! at 0x8000. It generates an update while the compare value is still 0, which is what the counter holds then, and does
//! not clear the flag that this sets (`CC1IF`, RM0433 section 39.4.5; crate rigless 0.4.0 sets it). The first interrupt
//! counts it, so the clock is half a turn ahead, and its parity is wrong for good: a reading between a half turn and
//! its interrupt is 65.5 ms too early, and time steps back. Whether the part sets the flag was not measured; clearing
//! it does no harm.

use critical_section::with;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::regs::SrGp16;

/// Mask of `CC1IF` in `TIM2_SR`.
const COMPARE_1: u32 = 1 << 1;

/// Calls `start`, which starts embassy's clock, and clears the flag before its interrupt comes. The first true one
/// comes half a turn later, after 32.8 ms.
pub fn begin<R>(start: impl FnOnce() -> R) -> R {
    with(|_| {
        let started = start();
        // Writing 0 clears a flag, and writing 1 leaves it.
        pac::TIM2.sr().write_value(SrGp16(!COMPARE_1));
        started
    })
}
