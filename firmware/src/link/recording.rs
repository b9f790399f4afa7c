//! Streams of recordings: blocks of samples, published to the host that asked for them.

use embassy_time::Timer;
use static_cell::ConstStaticCell;
use stylus_app::control::Control;
use stylus_app::requests::{Frame, encode_block};

use crate::link::storage::with_control;
use crate::link::wire::Wire;

/// Sends blocks as they come, and empties the queue while nothing is recorded.
#[embassy_executor::task]
pub async fn stream() -> ! {
    static FRAME: ConstStaticCell<Frame> = ConstStaticCell::new([0; _]);
    let frame = FRAME.take();
    loop {
        let Some((link, block)) = with_control(Control::next_block) else {
            // A block comes every 6.4 ms.
            Timer::after_millis(2).await;
            continue;
        };
        if let Some(length) = encode_block(&block, frame) {
            // A block that is not taken in time is counted by its wire, and the gap in the numbers shows it to the
            // host.
            Wire::of(link).send(&frame[..length]).await;
        }
    }
}
