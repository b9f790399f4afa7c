//! The far end of the serial line, in this process. Bytes for the image arrive from the instant at which the run
//! continues. Bytes from the image are kept with their instants. The host's clock has no influence, so a run repeats
//! exactly.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A byte that the image sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// Instant of the end of the byte's stop bit, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The byte.
    pub byte: u8,
}

/// The far end.
#[derive(Debug, Default)]
pub struct Line {
    to_image: VecDeque<u8>,
    from_image: Vec<Sent>,
}

impl Line {
    /// Puts `bytes` on the line, after the bytes that wait already.
    pub fn put(&mut self, bytes: &[u8]) {
        self.to_image.extend(bytes);
    }

    /// Number of bytes that the image's receiver has not begun to receive.
    pub fn waiting(&self) -> usize {
        self.to_image.len()
    }

    /// Returns the bytes that the image has sent since the last call.
    pub fn take(&mut self) -> Vec<Sent> {
        std::mem::take(&mut self.from_image)
    }
}

impl Store for Line {}

impl Peer for Line {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let [byte, _] = word.to_le_bytes();
        self.from_image.push(Sent {
            at_ns: context.now().0,
            byte,
        });
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.to_image.pop_front().map(u16::from)
    }
}
