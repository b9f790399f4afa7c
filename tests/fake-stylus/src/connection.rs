//! One TCP connection that carries the COBS frames of the serial link, with injected faults.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use model_format::link::DeviceInfo;

/// Faults that hold from the moment at which they are set.
#[derive(Clone, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a fault of its own, and any may come together"
)]
pub struct Faults {
    /// Changes what the device reports about itself, if set.
    pub disguise: Option<fn(&mut DeviceInfo)>,
    /// Number of frames after which the connection is closed, before the last of them is answered. Each connection
    /// counts from zero.
    pub close_every: Option<usize>,
    /// True to send no answer at all.
    pub silent: bool,
    /// Delay of every answer, in real time.
    pub late: Duration,
    /// Number of frames of a connection whose answers are sent. Further answers wait until this fault is gone.
    pub holds_after: Option<usize>,
    /// The last of every so many answers is damaged in transit.
    pub corrupt_every: Option<usize>,
    /// The last of every so many blocks of a recording is lost in transit.
    pub lose_block_every: Option<usize>,
    /// Path of a request. From the first that arrives, every request that needs the flash is refused, like by a device
    /// whose storage is busy.
    pub busy_from: Option<&'static str>,
    /// True to never notice the loss of a link, so that the output continues without a host.
    pub ignores_lost_link: bool,
    /// True to count one tick of each millisecond as missed.
    pub misses_ticks: bool,
    /// True to count the codes of one tick of each millisecond as too late at the output.
    pub puts_out_late: bool,
    /// Extra cycles that are added to the duration of every tick.
    pub slower_by: u32,
    /// True to send bytes that form no frame before every answer.
    pub noise: bool,
}

/// Longest wait of a read. It is short so that ticks and jobs continue meanwhile.
const READ_TIMEOUT: Duration = Duration::from_millis(1);

/// Largest number of reads in which a host's end is looked for. A host that sends on meanwhile is there.
const MOST_READS: usize = 8;

/// An open connection to a host.
pub struct Connection {
    stream: TcpStream,
    is_open: bool,
    /// Received bytes of a frame that is not complete yet.
    encoded: Vec<u8>,
    /// Bytes to send, each with the time at which they are due.
    waiting: Vec<(Instant, Vec<u8>)>,
    /// Answers that [`Faults::holds_after`] holds back.
    held: Vec<(Instant, Vec<u8>)>,
    frames: usize,
    answers: usize,
    blocks: usize,
}

impl Connection {
    /// Creates a connection over `stream`.
    pub fn new(stream: TcpStream) -> Self {
        // On some systems an accepted socket is non-blocking like its listener.
        stream.set_nonblocking(false).expect("a socket can block");
        // Otherwise an answer waits until the host has acknowledged the one before (Nagle's algorithm).
        stream.set_nodelay(true).expect("a socket can send at once");
        stream
            .set_read_timeout(Some(READ_TIMEOUT))
            .expect("a socket has a timeout");
        Self {
            stream,
            is_open: true,
            encoded: Vec::new(),
            waiting: Vec::new(),
            held: Vec::new(),
            frames: 0,
            answers: 0,
            blocks: 0,
        }
    }

    /// True until either end has closed the connection.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// True if no answer waits to be sent.
    pub fn has_sent_all(&self) -> bool {
        self.waiting.is_empty() && self.held.is_empty()
    }

    /// Reads what has arrived, and returns true unless the host has closed the connection.
    pub fn is_held(&mut self) -> bool {
        for _ in 0..MOST_READS {
            if !self.read() {
                break;
            }
        }
        self.is_open
    }

    /// Reads some of the bytes that have arrived. Waits for [`READ_TIMEOUT`] at most. Returns false if there are none.
    fn read(&mut self) -> bool {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(count) if count > 0 => {
                self.encoded.extend(&buffer[..count]);
                true
            }
            Err(failure) if matches!(failure.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => false,
            _ => {
                self.is_open = false;
                false
            }
        }
    }

    /// Returns the frames that have arrived, decoded. Waits for [`READ_TIMEOUT`] at most.
    pub fn receive(&mut self) -> Vec<Vec<u8>> {
        self.read();
        let mut frames = Vec::new();
        while let Some(end) = self.encoded.iter().position(|&byte| byte == 0) {
            let encoded: Vec<u8> = self.encoded.drain(..=end).collect();
            if end > 0
                && let Ok(frame) = cobs::decode_vec(&encoded[..end])
            {
                frames.push(frame);
            }
        }
        frames
    }

    /// Counts a frame that was served. Returns false if [`Faults::close_every`] closes the connection with this frame.
    pub fn count_frame(&mut self, faults: &Faults) -> bool {
        self.frames += 1;
        self.is_open &= faults.close_every.is_none_or(|n| self.frames < n);
        self.is_open
    }

    /// Queues an answer, subject to `faults`.
    pub fn answer(&mut self, answer: &[u8], faults: &Faults) {
        if faults.silent {
            return;
        }
        self.answers += 1;
        if faults.noise {
            for noise in [vec![0, 0xff, 3, 7, 0], vec![0x55; 3000], vec![0]] {
                self.waiting.push((Instant::now(), noise));
            }
        }
        let is_corrupt = |n| self.answers.is_multiple_of(n);
        let encoded = if faults.corrupt_every.is_some_and(is_corrupt) {
            // The length is impossible for a COBS frame of these bytes.
            vec![0xfe, 1, 2, 0]
        } else {
            encoded(answer)
        };
        let is_held = faults.holds_after.is_some_and(|n| self.frames > n);
        let queue = if is_held { &mut self.held } else { &mut self.waiting };
        queue.push((Instant::now() + faults.late, encoded));
    }

    /// Queues a block of a recording, unless [`Faults::lose_block_every`] loses it.
    pub fn block(&mut self, block: &[u8], faults: &Faults) {
        self.blocks += 1;
        if faults.lose_block_every.is_none_or(|n| !self.blocks.is_multiple_of(n)) {
            self.waiting.push((Instant::now(), encoded(block)));
        }
    }

    /// Sends what is due, subject to `faults`.
    pub fn flush(&mut self, faults: &Faults) {
        if faults.holds_after.is_none() {
            self.waiting.append(&mut self.held);
        }
        let now = Instant::now();
        let (due, later): (Vec<_>, Vec<_>) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|(at, _)| *at <= now);
        self.waiting = later;
        for (_, bytes) in due {
            self.is_open &= self.stream.write_all(&bytes).is_ok();
        }
    }
}

/// Returns a frame as it is sent.
fn encoded(frame: &[u8]) -> Vec<u8> {
    let mut encoded = cobs::encode_vec(frame);
    encoded.push(0);
    encoded
}
