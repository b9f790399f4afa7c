//! Frames as USB bulk transfers. A frame ends with a short packet, or with an empty packet if its length is a multiple
//! of the packet length (USB 2.0 section 5.8.3).

use std::io;
use std::sync::Arc;

use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::host_client::{WireRx, WireTx};

use super::health::Health;

/// Number of queued transfers from the device, so that no frame of the device waits for the host.
const WAITING_TRANSFERS: usize = 8;

/// A bulk endpoint from the host to a device.
pub(super) trait BulkOut: Send + 'static {
    /// Longest packet, bytes.
    fn packet_bytes(&self) -> usize;

    /// Appends a transfer to the queue.
    fn submit(&mut self, data: Vec<u8>);

    /// Number of transfers in the queue.
    fn pending(&self) -> usize;

    /// Waits until the first transfer in the queue has ended.
    fn next(&mut self) -> impl Future<Output = io::Result<()>> + Send;

    /// Clears the halt at both ends and resets their data toggles to DATA0. The queue must be empty.
    fn clear_halt(&mut self) -> impl Future<Output = io::Result<()>> + Send;
}

/// A bulk endpoint from a device to the host.
pub(super) trait BulkIn: Send + 'static {
    /// Longest packet, bytes.
    fn packet_bytes(&self) -> usize;

    /// Appends a transfer of at most `bytes` bytes to the queue.
    fn submit(&mut self, bytes: usize);

    /// Waits until the first transfer in the queue has ended, and returns its bytes.
    fn next(&mut self) -> impl Future<Output = io::Result<Vec<u8>>> + Send;

    /// Clears the halt at both ends and resets their data toggles to DATA0. The queue must be empty.
    fn clear_halt(&mut self) -> impl Future<Output = io::Result<()>> + Send;
}

/// Opens both directions of a link over `output` and `input`, and discards what an earlier program left unfinished.
pub(super) async fn open<O: BulkOut, I: BulkIn>(
    mut output: O,
    mut input: I,
    health: &Arc<Health>,
) -> io::Result<(UsbTx<O>, UsbRx<I>)> {
    // Clearing a halt makes the device drop unfinished frames of both directions, even if nothing was halted.
    output.clear_halt().await?;
    input.clear_halt().await?;
    Ok((
        UsbTx {
            endpoint: output,
            health: health.clone(),
        },
        UsbRx::new(input, health.clone()),
    ))
}

/// The sending end.
pub(super) struct UsbTx<O> {
    endpoint: O,
    health: Arc<Health>,
}

impl<O: BulkOut> WireTx for UsbTx<O> {
    type Error = io::Error;

    async fn send(&mut self, frame: Vec<u8>) -> io::Result<()> {
        let is_full = frame.len().is_multiple_of(self.endpoint.packet_bytes());
        self.endpoint.submit(frame);
        if is_full {
            self.endpoint.submit(Vec::new());
        }
        // A frame counts as sent when its transfers have ended, so that a queue in the operating system cannot grow.
        while self.endpoint.pending() > 0 {
            self.endpoint
                .next()
                .await
                .inspect_err(|failure| self.health.end(failure))?;
        }
        Ok(())
    }
}

/// The receiving end.
pub(super) struct UsbRx<I> {
    endpoint: I,
    /// Length of a transfer, bytes: the longest frame, rounded up to whole packets.
    bytes: usize,
    health: Arc<Health>,
}

impl<I: BulkIn> UsbRx<I> {
    fn new(mut endpoint: I, health: Arc<Health>) -> Self {
        let bytes = MAX_DEVICE_FRAME_BYTES.next_multiple_of(endpoint.packet_bytes());
        for _ in 0..WAITING_TRANSFERS {
            endpoint.submit(bytes);
        }
        Self {
            endpoint,
            bytes,
            health,
        }
    }
}

impl<I: BulkIn> WireRx for UsbRx<I> {
    type Error = io::Error;

    async fn receive(&mut self) -> io::Result<Vec<u8>> {
        loop {
            let ended = self.endpoint.next().await;
            let frame = ended.inspect_err(|failure| self.health.end(failure))?;
            // The transfer that has ended is replaced at once, so that always the same number waits for the device.
            self.endpoint.submit(self.bytes);
            // A frame that fills its whole transfer leaves its closing empty packet to the next one.
            if !frame.is_empty() {
                return Ok(frame);
            }
        }
    }
}
