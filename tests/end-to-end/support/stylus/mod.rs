//! A stylus behind a TCP port: the device's own application, with faults on request.

#![allow(dead_code, unused_imports, reason = "each test uses a part of it")]

mod bench;
mod dispatch;
#[path = "../../../../firmware/app/tests/app/flash.rs"]
mod flash;
#[path = "../../../../firmware/app/tests/app/library.rs"]
mod library;

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use model_format::link::{DeviceInfo, MotionSample, MotionTopic, RecordBlockTopic};
use postcard_rpc::header::{VarHeader, VarKey};
use postcard_rpc::standard_icd::{ERROR_KEY, WireError};
use postcard_rpc::{Topic, postcard};

pub use bench::Hand;
use bench::Stylus;
pub use library::library;

/// What goes wrong on purpose, from the moment it is set.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// The device says that it is another.
    pub disguise: Option<fn(&mut DeviceInfo)>,
    /// After so many frames the connection is closed, before the answer to the last; then again after as many.
    pub close_every: Option<usize>,
    /// Nothing is answered.
    pub silent: bool,
    /// Answers come later.
    pub late: Duration,
    /// Every so many answers one is broken on its way.
    pub corrupt_every: Option<usize>,
    /// Every so many blocks of a recording one does not arrive.
    pub lose_block_every: Option<usize>,
    /// The flash is busy with something else, and what needs it is not taken.
    pub busy: bool,
    /// Bytes that are no frame come before every answer.
    pub noise: bool,
}

#[derive(Default)]
struct Inner {
    faults: Faults,
    heard: Vec<Heard>,
    hand: Hand,
    lose_samples: u32,
    connections: usize,
    is_over: bool,
}

/// A frame that arrived.
#[derive(Clone, Debug)]
pub struct Heard {
    pub at: Instant,
    pub path: &'static str,
    /// Of a motion that wants no answer.
    pub motion: Option<MotionSample>,
}

/// A stylus that can be reached.
pub struct TestStylus {
    port: u16,
    inner: Arc<Mutex<Inner>>,
    thread: Option<JoinHandle<()>>,
}

impl TestStylus {
    /// Boots it on blank flash.
    pub fn boot() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("there is a port");
        listener.set_nonblocking(true).expect("it can be polled");
        let port = listener.local_addr().expect("it is bound").port();
        let inner = Arc::new(Mutex::new(Inner::default()));
        let shared = inner.clone();
        let thread = thread::spawn(move || run(&listener, &shared));
        Self {
            port,
            inner,
            thread: Some(thread),
        }
    }

    /// Where it is, for `--link`.
    pub fn link(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.port)
    }

    pub fn port(&self) -> u16 {
        self.port
    }

    pub fn fail(&self, faults: Faults) {
        self.inner.lock().unwrap().faults = faults;
    }

    pub fn set_hand(&self, hand: Hand) {
        self.inner.lock().unwrap().hand = hand;
    }

    /// The recorder misses so many samples.
    pub fn lose_samples(&self, samples: u32) {
        self.inner.lock().unwrap().lose_samples = samples;
    }

    /// The frames so far; forgets them.
    pub fn take_heard(&self) -> Vec<Heard> {
        std::mem::take(&mut self.inner.lock().unwrap().heard)
    }

    /// The frames so far for `path`.
    pub fn count(&self, path: &str) -> usize {
        let inner = self.inner.lock().unwrap();
        inner
            .heard
            .iter()
            .filter(|heard| heard.path == path)
            .count()
    }

    pub fn connections(&self) -> usize {
        self.inner.lock().unwrap().connections
    }
}

impl Drop for TestStylus {
    fn drop(&mut self) {
        self.inner.lock().unwrap().is_over = true;
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join)
            && !thread::panicking()
        {
            std::panic::resume_unwind(panic);
        }
    }
}

fn run(listener: &TcpListener, shared: &Mutex<Inner>) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .expect("it needs nothing");
    let mut stylus = runtime.block_on(Stylus::boot());
    let begin = Instant::now();
    let mut link: Option<Link> = None;
    loop {
        {
            let mut inner = shared.lock().unwrap();
            if inner.is_over {
                return;
            }
            let mut control = stylus.control.borrow_mut();
            control.device().hand = inner.hand.clone();
            control.device().lose_samples += std::mem::take(&mut inner.lose_samples);
        }
        if let Ok((stream, _)) = listener.accept() {
            shared.lock().unwrap().connections += 1;
            link = Some(Link::new(stream));
        }
        // A tick is 200 µs.
        let tick = begin.elapsed().as_micros() as u64 / 200;
        let blocks = stylus.run_until(tick);
        let Some(open) = &mut link else {
            thread::sleep(Duration::from_millis(1));
            continue;
        };
        let mut is_open = true;
        let frames = open.receive(&mut is_open);
        // As they are now, and not before the wait for the frames.
        let faults = shared.lock().unwrap().faults.clone();
        for block in blocks {
            open.blocks += 1;
            if faults
                .lose_block_every
                .is_none_or(|n| !open.blocks.is_multiple_of(n))
            {
                let header = VarHeader {
                    key: VarKey::Key8(RecordBlockTopic::TOPIC_KEY),
                    seq_no: (block.sequence as u16).into(),
                };
                let frame = dispatch::frame(RecordBlockTopic::TOPIC_KEY, header, &block);
                open.send_later(&frame, Duration::ZERO);
            }
        }
        for bytes in frames {
            let Some((header, body)) = VarHeader::take_from_slice(&bytes) else {
                continue;
            };
            note(shared, &header, body);
            let disguise = |info: &mut DeviceInfo| {
                if let Some(disguise) = faults.disguise {
                    disguise(info);
                }
            };
            let answer = if faults.busy && dispatch::needs_flash(&header) {
                Some(dispatch::frame(
                    ERROR_KEY,
                    header,
                    &WireError::FailedToSpawn,
                ))
            } else {
                runtime.block_on(dispatch::serve(&mut stylus, &header, body, disguise))
            };
            open.frames += 1;
            if faults.close_every.is_some_and(|n| open.frames >= n) {
                is_open = false;
                break;
            }
            if let Some(answer) = answer
                && !faults.silent
            {
                open.answer(&answer, &faults);
            }
        }
        open.flush(&mut is_open);
        if !is_open {
            link = None;
        }
    }
}

fn note(shared: &Mutex<Inner>, header: &VarHeader, body: &[u8]) {
    let is_motion = header.key == VarKey::Key8(MotionTopic::TOPIC_KEY);
    shared.lock().unwrap().heard.push(Heard {
        at: Instant::now(),
        path: dispatch::path_of(header).unwrap_or("?"),
        motion: is_motion.then(|| postcard::from_bytes(body).ok()).flatten(),
    });
}

/// One connection.
struct Link {
    stream: TcpStream,
    encoded: Vec<u8>,
    waiting: Vec<(Instant, Vec<u8>)>,
    frames: usize,
    answers: usize,
    blocks: usize,
}

impl Link {
    fn new(stream: TcpStream) -> Self {
        stream.set_nonblocking(false).expect("it can wait");
        stream.set_nodelay(true).expect("it can hurry");
        let patience = Duration::from_millis(1);
        stream
            .set_read_timeout(Some(patience))
            .expect("it can wait");
        Self {
            stream,
            encoded: Vec::new(),
            waiting: Vec::new(),
            frames: 0,
            answers: 0,
            blocks: 0,
        }
    }

    fn receive(&mut self, is_open: &mut bool) -> Vec<Vec<u8>> {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(0) => *is_open = false,
            Ok(count) => self.encoded.extend(&buffer[..count]),
            Err(failure)
                if matches!(failure.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => *is_open = false,
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

    fn answer(&mut self, answer: &[u8], faults: &Faults) {
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

    fn send_later(&mut self, frame: &[u8], late: Duration) {
        let mut encoded = cobs::encode_vec(frame);
        encoded.push(0);
        self.waiting.push((Instant::now() + late, encoded));
    }

    fn flush(&mut self, is_open: &mut bool) {
        let now = Instant::now();
        let (due, later) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|(at, _)| *at <= now);
        self.waiting = later;
        let due: Vec<(Instant, Vec<u8>)> = due;
        for (_, bytes) in due {
            *is_open &= self.stream.write_all(&bytes).is_ok();
        }
    }
}
