//! The task that raises the amplifier's enable.

use embassy_time::{Duration, Timer};

use crate::tick::handler;
use crate::tick::output::{self, amplifier};

/// Time for which mid-scale must have been put out before the amplifier is turned on, ms.
const SETTLING_MS: u32 = 10;

/// Time between two looks, first while the amplifier is to be raised, then otherwise.
const LOOK: Duration = Duration::from_millis(1);
const IDLE: Duration = Duration::from_millis(20);

/// Raises the amplifier's enable once it is requested and the output has been at mid-scale for [`SETTLING_MS`], checked
/// once per millisecond.
#[embassy_executor::task]
pub async fn raise_amplifier() -> ! {
    let mut settled = 0;
    let mut ticks = handler::now();
    loop {
        let wanted = amplifier::is_to_be_raised();
        Timer::after(if wanted { LOOK } else { IDLE }).await;
        // Without a new tick, the rest that the tick reports would be an old one.
        let before = core::mem::replace(&mut ticks, handler::now());
        let settling = wanted && ticks != before && handler::is_at_rest(0) && output::is_driven_at_mid_scale();
        settled = if settling { settled + 1 } else { 0 };
        if settled > SETTLING_MS {
            amplifier::raise();
            settled = 0;
        }
    }
}
