//! Streams of recordings: blocks of samples, published to the host that asked for them.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_time::Timer;
use model_format::link::{RecordBlockTopic, RecordError, RecordStarted};
use postcard_rpc::header::VarSeq;
use postcard_rpc::server::Sender;
use stylus_app::control::{Control, Device};

use crate::link::storage::with_control;
use crate::link::wire::{KEY_KIND, Wire};

/// The wire that blocks go to.
static LISTENER: Mutex<ThreadModeRawMutex, Cell<Wire>> = Mutex::new(Cell::new(Wire::Serial));

/// Starts a recording for the host on `wire`.
///
/// # Errors
/// One is under way.
pub fn start(wire: Wire) -> Result<RecordStarted, RecordError> {
    let started = with_control(Control::record_start)?;
    LISTENER.lock(|listener| listener.set(wire));
    Ok(started)
}

/// Sends blocks as they come, and empties the queue while nothing is recorded.
#[embassy_executor::task]
pub async fn stream() -> ! {
    loop {
        let block = with_control(|control| {
            let device = control.device();
            let now = device.now();
            device.recorder.next_block(now)
        });
        let Some(block) = block else {
            // A block comes every 6.4 ms.
            Timer::after_millis(2).await;
            continue;
        };
        let sender = Sender::new(LISTENER.lock(Cell::get), KEY_KIND);
        // A block that is not taken in time is counted by its wire, and the gap in the numbers shows it to the host.
        let _ = sender
            .publish::<RecordBlockTopic>(VarSeq::Seq4(block.sequence), &block)
            .await;
    }
}
