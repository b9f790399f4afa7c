//! The task that raises the amplifier's enable.

use embassy_time::{Duration, Ticker};

use crate::tick::handler;
use crate::tick::output::{self, amplifier};

/// Time for which mid-scale must have been put out, ms.
const SETTLING_MS: u32 = 10;

/// Raises the amplifier whenever it is to be on and the output has been at mid-scale for [`SETTLING_MS`], seen once per
/// millisecond.
#[embassy_executor::task]
pub async fn raise_amplifier() -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(1));
    let mut settled = 0;
    let mut ticks = handler::now();
    loop {
        ticker.next().await;
        let before = core::mem::replace(&mut ticks, handler::now());
        let settling = amplifier::is_to_be_raised()
            && ticks != before
            && handler::is_at_rest(0)
            && output::is_driven_at_mid_scale();
        settled = if settling { settled + 1 } else { 0 };
        if settled >= SETTLING_MS {
            amplifier::raise();
        }
    }
}
