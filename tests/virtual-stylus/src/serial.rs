//! The far end of the serial line, in this process: bytes put on it are heard from the instant the run goes on, and what
//! the image sends is kept with its instants. Without time of the host's in it, a run repeats exactly.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A byte that the image sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// When its stop bit ended, in nanoseconds of virtual time.
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
    /// Puts `bytes` on the line, behind what is there.
    pub fn put(&mut self, bytes: &[u8]) {
        self.to_image.extend(bytes);
    }

    /// Bytes that the image's receiver has not begun to take.
    pub fn waiting(&self) -> usize {
        self.to_image.len()
    }

    /// What the image sent since this was asked last.
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
