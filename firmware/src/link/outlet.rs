//! The way out of one link: its sender and the buffer of a frame, for one frame at a time.

use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, with_timeout};
use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::server::WireTxErrorKind;

use crate::link::counters::Counters;

/// Longest time that a frame may take: the longest frame takes 12 ms on the serial wire.
const SEND_LIMIT: Duration = Duration::from_millis(100);

/// Buffer of one frame before it is sent.
pub type Frame = [u8; MAX_DEVICE_FRAME_BYTES];

/// The sender of a link and its buffer. One frame is sent at a time.
pub struct Outlet<S> {
    inner: Mutex<ThreadModeRawMutex, Option<(S, Frame)>>,
    counters: &'static Counters,
}

/// Sender of a link.
pub trait SendFrame {
    /// Sends one frame; returns false if the link does not take it.
    async fn send_frame(&mut self, frame: &[u8]) -> bool;
}

impl<S: SendFrame> Outlet<S> {
    /// An outlet that is not open: its frames are dropped and counted as unsent.
    pub const fn new(counters: &'static Counters) -> Self {
        Self {
            inner: Mutex::new(None),
            counters,
        }
    }

    /// Opens the outlet onto `sender`.
    pub async fn open(&self, sender: S) {
        *self.inner.lock().await = Some((sender, [0; MAX_DEVICE_FRAME_BYTES]));
    }

    /// Sends the frame that `write` puts into the buffer.
    ///
    /// # Errors
    /// The link is not open, the frame does not fit, or the link does not take it in time; the loss is counted.
    pub async fn send(
        &self,
        write: impl FnOnce(&mut Frame) -> Option<usize>,
    ) -> Result<(), WireTxErrorKind> {
        let sent = with_timeout(SEND_LIMIT, async {
            let mut inner = self.inner.lock().await;
            let (sender, frame) = inner.as_mut()?;
            let length = write(frame)?;
            sender.send_frame(&frame[..length]).await.then_some(())
        });
        if let Ok(Some(())) = sent.await {
            return Ok(());
        }
        // The loss is counted, and the link goes on, because the host may come back at any time.
        self.counters.count(|counters| &mut counters.unsent);
        Err(WireTxErrorKind::Other)
    }
}
