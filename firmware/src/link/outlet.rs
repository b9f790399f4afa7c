//! The way out of one link: its sender and the buffer of a frame, for one frame at a time.

use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, with_timeout};
use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::server::WireTxErrorKind;

use crate::link::counters::Counters;

/// Longest time that a frame may take: the longest frame takes 12 ms on the serial wire.
const SEND_LIMIT: Duration = Duration::from_millis(100);

/// One frame before it is sent.
pub type Frame = [u8; MAX_DEVICE_FRAME_BYTES];

/// What takes frames to the host: a link's sending half and its buffer, one frame at a time.
pub struct Outlet<S> {
    inner: Mutex<ThreadModeRawMutex, Option<(S, Frame)>>,
    counters: &'static Counters,
}

/// A link's sending half.
pub trait SendFrame {
    /// Sends one frame; false if the link does not take it.
    async fn send_frame(&mut self, frame: &[u8]) -> bool;
}

impl<S: SendFrame> Outlet<S> {
    /// Not yet open; frames are dropped and counted as unsent.
    pub const fn new(counters: &'static Counters) -> Self {
        Self {
            inner: Mutex::new(None),
            counters,
        }
    }

    /// Opens it.
    pub async fn open(&self, half: S) {
        *self.inner.lock().await = Some((half, [0; MAX_DEVICE_FRAME_BYTES]));
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
            let (half, frame) = inner.as_mut()?;
            let length = write(frame)?;
            half.send_frame(&frame[..length]).await.then_some(())
        });
        if let Ok(Some(())) = sent.await {
            return Ok(());
        }
        // A frame that is lost is counted and the link goes on: it may come back at any moment.
        self.counters.count(|counters| &mut counters.unsent);
        Err(WireTxErrorKind::Other)
    }
}
