//! One TCP connection, as the stream of COBS frames that the serial link carries, with faults that are injected on
//! purpose.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use model_format::link::DeviceInfo;

/// Faults that hold from the moment when they are set.
#[derive(Clone, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a fault of its own, and any may come together"
)]
pub struct Faults {
    /// Change of what the device says about itself.
    pub disguise: Option<fn(&mut DeviceInfo)>,
    /// Number of frames after which the connection is closed, before the answer to the last; counted anew per
    /// connection.
    pub close_every: Option<usize>,
    /// No answer at all.
    pub silent: bool,
    /// Delay of every answer.
    pub late: Duration,
    /// Number of answers of which the last one is damaged on its way.
    pub corrupt_every: Option<usize>,
    /// Number of blocks of a recording of which the last one is lost on its way.
    pub lose_block_every: Option<usize>,
    /// Refusal of every request that needs the flash, as of a device that is busy with others.
    pub busy: bool,
    /// No loss of the link is ever noticed, so that the output goes on without a host.
    pub ignores_lost_link: bool,
    /// One tick of each millisecond counts as missed.
    pub misses_ticks: bool,
    /// The codes of one tick of each millisecond count as too late at the output.
    pub puts_out_late: bool,
    /// Cycles that every tick takes besides its own.
    pub slower_by: u32,
    /// Bytes that are no frame, before every answer.
    pub noise: bool,
}

/// Time that a read may wait, so that ticks and jobs go on meanwhile.
const READ_TIMEOUT: Duration = Duration::from_millis(1);

/// An open connection to a host.
pub struct Connection {
    stream: TcpStream,
    is_open: bool,
    /// Bytes of a frame that has not ended.
    encoded: Vec<u8>,
    /// Bytes to send, each with its time.
    waiting: Vec<(Instant, Vec<u8>)>,
    frames: usize,
    answers: usize,
    blocks: usize,
}

impl Connection {
    /// A connection over `stream`.
    pub fn new(stream: TcpStream) -> Self {
        stream.set_nonblocking(false).expect("a socket can block");
        stream.set_nodelay(true).expect("a socket can send at once");
        stream
            .set_read_timeout(Some(READ_TIMEOUT))
            .expect("a socket has a timeout");
        Self {
            stream,
            is_open: true,
            encoded: Vec::new(),
            waiting: Vec::new(),
            frames: 0,
            answers: 0,
            blocks: 0,
        }
    }

    /// True until one of the two sides has closed it.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// True if no answer waits to be sent.
    pub fn has_sent_all(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The frames that have arrived, decoded; waits for [`READ_TIMEOUT`] at most.
    pub fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(0) => self.is_open = false,
            Ok(count) => self.encoded.extend(&buffer[..count]),
            Err(failure)
                if matches!(failure.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => self.is_open = false,
        }
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

    /// Counts a frame that was served. False if the connection ends with it, by [`Faults::close_every`].
    pub fn count_frame(&mut self, faults: &Faults) -> bool {
        self.frames += 1;
        self.is_open &= faults.close_every.is_none_or(|n| self.frames < n);
        self.is_open
    }

    /// Queues an answer, with the faults that it meets.
    pub fn answer(&mut self, answer: &[u8], faults: &Faults) {
        if faults.silent {
            return;
        }
        self.answers += 1;
        if faults.noise {
            self.waiting.push((Instant::now(), vec![0, 0xff, 3, 7, 0]));
            self.waiting.push((Instant::now(), vec![0x55; 3000]));
            self.waiting.push((Instant::now(), vec![0]));
        }
        if faults
            .corrupt_every
            .is_some_and(|n| self.answers.is_multiple_of(n))
        {
            // A length that no COBS frame of these bytes has.
            self.waiting
                .push((Instant::now() + faults.late, vec![0xfe, 1, 2, 0]));
        } else {
            self.send_later(answer, faults.late);
        }
    }

    /// Queues a block of a recording, unless [`Faults::lose_block_every`] loses it.
    pub fn block(&mut self, block: &[u8], faults: &Faults) {
        self.blocks += 1;
        if faults
            .lose_block_every
            .is_none_or(|n| !self.blocks.is_multiple_of(n))
        {
            self.send_later(block, Duration::ZERO);
        }
    }

    fn send_later(&mut self, frame: &[u8], late: Duration) {
        let mut encoded = cobs::encode_vec(frame);
        encoded.push(0);
        self.waiting.push((Instant::now() + late, encoded));
    }

    /// Sends what is due.
    pub fn flush(&mut self) {
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
