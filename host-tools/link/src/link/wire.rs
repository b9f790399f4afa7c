//! Frames on a wire, and the state of a link apart from its frames.
//!
//! Over a stream of bytes each frame is COBS-encoded and ends with a zero byte. Over USB it is a bulk transfer: it ends
//! with a short packet, or with an empty packet if its length is a multiple of the packet length (USB 2.0 section
//! 5.8.3).

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::host_client::{WireRx, WireSpawn, WireTx};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

/// Runs the client's two tasks on the current runtime.
pub(super) struct Spawn;

impl WireSpawn for Spawn {
    fn spawn(&mut self, task: impl Future<Output = ()> + Send + 'static) {
        drop(tokio::spawn(task));
    }
}

/// The sending end.
pub(super) struct CobsTx<W> {
    writer: W,
    health: Arc<Health>,
}

impl<W: AsyncWrite + Send + Unpin + 'static> CobsTx<W> {
    /// Opens the sending end over `writer`, with a zero byte that ends an unfinished frame of an earlier program.
    pub(super) async fn open(mut writer: W, health: Arc<Health>) -> io::Result<Self> {
        writer.write_all(&[0]).await?;
        writer.flush().await?;
        Ok(Self { writer, health })
    }
}

impl<W: AsyncWrite + Send + Unpin + 'static> WireTx for CobsTx<W> {
    type Error = io::Error;

    async fn send(&mut self, frame: Vec<u8>) -> io::Result<()> {
        let mut encoded = cobs::encode_vec(&frame);
        encoded.push(0);
        let sent = match self.writer.write_all(&encoded).await {
            Ok(()) => self.writer.flush().await,
            failed => failed,
        };
        sent.inspect_err(|failure| self.health.end(failure))
    }
}

/// The receiving end.
pub(super) struct CobsRx<R> {
    reader: R,
    decoder: FrameDecoder,
    ready: VecDeque<Vec<u8>>,
    health: Arc<Health>,
}

impl<R> CobsRx<R> {
    /// A receiving end over `reader`.
    pub(super) fn new(reader: R, health: Arc<Health>) -> Self {
        Self {
            reader,
            decoder: FrameDecoder::default(),
            ready: VecDeque::new(),
            health,
        }
    }
}

impl<R: AsyncRead + Send + Unpin + 'static> WireRx for CobsRx<R> {
    type Error = io::Error;

    async fn receive(&mut self) -> io::Result<Vec<u8>> {
        let mut buffer = [0; 4096];
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Ok(frame);
            }
            let count = match self.reader.read(&mut buffer).await {
                Ok(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other side closed it")),
                other => other,
            }
            .inspect_err(|failure| self.health.end(failure))?;
            // One read may end several frames; they wait in `ready`, because each call returns one.
            for &byte in &buffer[..count] {
                match self.decoder.push(byte) {
                    Some(Ok(frame)) => self.ready.push_back(frame),
                    Some(Err(BrokenFrame)) => self.health.count_broken(),
                    None => {}
                }
            }
        }
    }
}

/// Separates a stream of bytes into frames.
#[derive(Default)]
pub struct FrameDecoder {
    encoded: Vec<u8>,
    /// True if the bytes are more than a frame can have; the rest is dropped up to the next zero.
    overlong: bool,
}

/// Bytes between two zeros that are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrokenFrame;

impl FrameDecoder {
    /// Decodes one byte, and returns the frame that the byte ends, if it ends one.
    pub fn push(&mut self, byte: u8) -> Option<Result<Vec<u8>, BrokenFrame>> {
        if byte != 0 {
            // Bytes that never hold a zero, such as another program's output, would fill the memory without this bound.
            if self.encoded.len() < cobs::max_encoding_length(MAX_DEVICE_FRAME_BYTES) {
                self.encoded.push(byte);
            } else {
                self.overlong = true;
            }
            return None;
        }
        let encoded = std::mem::take(&mut self.encoded);
        if std::mem::take(&mut self.overlong) {
            return Some(Err(BrokenFrame));
        }
        if encoded.is_empty() {
            // A sending end begins with a zero. It directly follows another zero if no frame was unfinished.
            return None;
        }
        let decoded = cobs::decode_vec(&encoded).map_err(|_| BrokenFrame);
        Some(decoded.and_then(|frame| {
            // A frame without bytes is no message, and none is sent.
            if (1..=MAX_DEVICE_FRAME_BYTES).contains(&frame.len()) {
                Ok(frame)
            } else {
                Err(BrokenFrame)
            }
        }))
    }
}

/// State of a link that its client does not report.
#[derive(Debug, Default)]
pub(super) struct Health {
    broken_frames: AtomicU64,
    ended: OnceLock<String>,
}

impl Health {
    /// Number of frames that arrived and could not be decoded.
    pub(super) fn broken_frames(&self) -> u64 {
        self.broken_frames.load(Ordering::Relaxed)
    }

    /// Counts a frame that could not be decoded.
    pub(super) fn count_broken(&self) {
        self.broken_frames.fetch_add(1, Ordering::Relaxed);
    }

    /// Reason for the end of the link.
    pub(super) fn why_ended(&self) -> &str {
        self.ended.get().map_or("it was closed", String::as_str)
    }

    /// Records the reason for the end of the link; a later reason does not replace the first.
    pub(super) fn end(&self, reason: &impl ToString) {
        self.ended.get_or_init(|| reason.to_string());
    }
}

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
pub(super) async fn open_bulk<O: BulkOut, I: BulkIn>(
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn decode(bytes: &[u8]) -> (Vec<Vec<u8>>, usize) {
        let mut decoder = FrameDecoder::default();
        let (mut frames, mut broken) = (Vec::new(), 0);
        for &byte in bytes {
            match decoder.push(byte) {
                Some(Ok(frame)) => frames.push(frame),
                Some(Err(BrokenFrame)) => broken += 1,
                None => {}
            }
        }
        (frames, broken)
    }

    #[test]
    fn a_frame_that_is_too_long_is_counted_and_the_next_one_is_whole() {
        let mut bytes = cobs::encode_vec(&[7; MAX_DEVICE_FRAME_BYTES + 1]);
        bytes.push(0);
        bytes.extend([9; 10_000]);
        bytes.push(0);
        bytes.extend(cobs::encode_vec(&[7; MAX_DEVICE_FRAME_BYTES]));
        bytes.push(0);
        assert_eq!(decode(&bytes), (vec![vec![7; MAX_DEVICE_FRAME_BYTES]], 2));
    }

    #[test]
    fn a_frame_without_bytes_is_broken() {
        assert_eq!(decode(&[0, 1, 0, 2, 7, 0]), (vec![vec![7]], 1));
    }

    proptest! {
        #[test]
        fn frames_come_out_as_they_went_in_whatever_noise_precedes_them(
            noise in prop::collection::vec(any::<u8>(), 0..2000),
            frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..600), 1..6),
        ) {
            let mut bytes = noise;
            bytes.push(0);
            let (before, broken) = decode(&bytes);
            for frame in &frames {
                bytes.extend(cobs::encode_vec(frame));
                bytes.push(0);
            }
            let (after, still_broken) = decode(&bytes);
            prop_assert_eq!(&after[before.len()..], &frames[..]);
            prop_assert_eq!(broken, still_broken);
        }
    }
}
