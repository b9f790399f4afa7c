//! Serves the requests that come over one link, and sends a recording to the host that asked for it.
//! [`stylus_app::requests`] implements the requests themselves.

use embassy_time::Timer;
use model_format::link::{LinkCounters, LinkId};
use static_cell::ConstStaticCell;
use stylus_app::control::Control;
use stylus_app::requests::{self, Frame, Link, QueuedJob, encode_block};

use crate::link::outlet::ReceiveFrame;
use crate::link::storage::{ControlStage, QUEUE, with_control};
use crate::link::wire::Wire;

impl Link for Wire {
    fn id(&self) -> LinkId {
        (*self).id()
    }

    fn count(&self, which: fn(&mut LinkCounters) -> &mut u32) {
        self.counters().count(which);
    }

    fn queue(&self, job: QueuedJob) -> bool {
        QUEUE.try_send(job).is_ok()
    }
}

/// Serves the host on `wire` forever. `receiver` puts frames into `buffer`; answers are written to `answer`.
pub async fn serve<R: ReceiveFrame>(
    wire: Wire,
    mut receiver: R,
    buffer: &'static mut [u8],
    answer: &'static mut Frame,
) -> ! {
    loop {
        let Some(length) = receiver.receive_frame(buffer).await else {
            continue;
        };
        if let Some(length) = serve_frame(wire, &buffer[..length], answer) {
            // The wire counts an answer that it cannot send. The host repeats its request.
            wire.send(&answer[..length]).await;
        }
    }
}

/// Dispatches a frame. It is not inlined, so that both links share one copy.
#[inline(never)]
fn serve_frame(wire: Wire, frame: &[u8], answer: &mut Frame) -> Option<usize> {
    #[cfg(feature = "fault-injection")]
    if stylus_realtime::injection::take(frame, stylus_realtime::tick::age) {
        wire.counters().count(|counters| &mut counters.frames);
        return None;
    }
    requests::serve(&ControlStage, &wire, frame, answer)
}

/// Sends the blocks of a recording as they come, and empties the queue while nothing is recorded.
#[embassy_executor::task]
pub async fn stream_recording() -> ! {
    static FRAME: ConstStaticCell<Frame> = ConstStaticCell::new([0; _]);
    let frame = FRAME.take();
    loop {
        let Some((link, block)) = with_control(Control::next_block) else {
            // A block comes every 6.4 ms.
            Timer::after_millis(2).await;
            continue;
        };
        if let Some(length) = encode_block(&block, frame) {
            // If a block is not accepted in time, its link counts the loss, and the gap in the numbers shows the loss
            // to the host.
            Wire::of(link).send(&frame[..length]).await;
        }
    }
}
