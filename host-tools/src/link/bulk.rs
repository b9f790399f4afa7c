//! Frames as USB bulk transfers: a frame ends with a packet that is not full, or an empty one.

use std::io;
use std::sync::Arc;

use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::host_client::{WireRx, WireTx};

use super::wire::Health;

/// Transfers that wait for the device at any time, so that none of its frames waits for us.
const WAITING_TRANSFERS: usize = 8;

/// An endpoint to a device.
pub(super) trait BulkOut: Send + 'static {
    /// Longest packet, bytes.
    fn packet_bytes(&self) -> usize;

    /// Has a transfer wait behind those that wait.
    fn submit(&mut self, data: Vec<u8>);

    /// Transfers that wait.
    fn pending(&self) -> usize;

    /// Waits until the first of them has ended.
    fn next(&mut self) -> impl Future<Output = io::Result<()>> + Send;

    /// Has both ends begin anew: no halt, and an even packet due. Nothing may wait.
    fn clear_halt(&mut self) -> impl Future<Output = io::Result<()>> + Send;
}

/// An endpoint from a device.
pub(super) trait BulkIn: Send + 'static {
    /// Longest packet, bytes.
    fn packet_bytes(&self) -> usize;

    /// Has a transfer of so many bytes wait behind those that wait.
    fn submit(&mut self, bytes: usize);

    /// Waits until the first of them has ended: what came.
    fn next(&mut self) -> impl Future<Output = io::Result<Vec<u8>>> + Send;

    /// Has both ends begin anew: no halt, and an even packet due. Nothing may wait.
    fn clear_halt(&mut self) -> impl Future<Output = io::Result<()>> + Send;
}

/// Both ends of a link over `output` and `input`, freed of whatever an earlier program left unfinished.
pub(super) async fn open<O: BulkOut, I: BulkIn>(
    mut output: O,
    mut input: I,
    health: &Arc<Health>,
) -> io::Result<(UsbTx<O>, UsbRx<I>)> {
    // The device drops what it has of a frame either way when a halt is cleared, whether there was one or not.
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
        while self.endpoint.pending() > 0 {
            let ended = self.endpoint.next().await;
            ended.inspect_err(|failure| self.health.end(failure))?;
        }
        Ok(())
    }
}

/// The receiving end.
pub(super) struct UsbRx<I> {
    endpoint: I,
    /// Bytes of a transfer: the longest frame, in whole packets.
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
            self.endpoint.submit(self.bytes);
            if !frame.is_empty() {
                return Ok(frame);
            }
        }
    }
}
