//! Service of the requests that come by one wire; what they do is in [`stylus_app::requests`].

use model_format::link::{LinkCounters, LinkId};
use stylus_app::requests::{self, Frame, Link, QueuedJob};

use crate::link::outlet::ReceiveFrame;
use crate::link::storage::{ControlStage, QUEUE};
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

/// Serves the host on `wire` forever. Frames come from `receiver` by `buffer`, and answers go by `answer`.
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

/// One copy of the dispatcher, for both wires.
#[inline(never)]
fn serve_frame(wire: Wire, frame: &[u8], answer: &mut Frame) -> Option<usize> {
    #[cfg(feature = "fault-injection")]
    if stylus_realtime::injection::take(frame) {
        wire.counters().count(|counters| &mut counters.frames);
        return None;
    }
    requests::serve(&ControlStage, &wire, frame, answer)
}
