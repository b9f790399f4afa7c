//! The product's own client, the link of `host-tools`, over the virtual bus.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use model_format::link::{MuteReasons, Status};
use stylus_link::link::capture::capture;
use stylus_link::link::play::{Drive, Driven, drive};
use stylus_link::link::upload::upload;
use stylus_link::link::{Device, LinkAddress, Timeouts};
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::motion::Motion;
use virtual_stylus::sockets::UsbSocket;
use virtual_stylus::{Reset, VirtualStylus};

use crate::device::{MS, product, recording_s};
use crate::library;
use crate::requests::{assert_even, play_request};

/// Virtual time between two checks of the socket, ns.
const STEP_NS: u64 = MS / 8;
/// Timeout of the client. It is long because the run may be slower than real time.
const PATIENCE: Duration = Duration::from_secs(10);

type Job = Box<dyn FnOnce(&mut VirtualStylus) + Send>;

/// A virtual stylus that runs on its own thread, no faster than real time, with its USB on a socket.
struct Running {
    address: LinkAddress,
    now_ns: Arc<AtomicU64>,
    ends: Arc<AtomicBool>,
    jobs: Sender<Job>,
    thread: Option<JoinHandle<(Vec<Output>, Vec<Reset>)>>,
}

impl Running {
    fn start() -> Self {
        let socket = UsbSocket::listen(0).expect("a free port");
        let port = socket.port().expect("it listens");
        let (now_ns, ends) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
        let (jobs, orders) = channel::<Job>();
        let (clock, over) = (now_ns.clone(), ends.clone());
        let thread = std::thread::spawn(move || {
            let mut socket = socket;
            let mut stylus = VirtualStylus::new(&product(), library::options()).expect("the image fits");
            stylus.run_for(300 * MS);
            let (began, from_ns) = (Instant::now(), stylus.now_ns());
            while !over.load(Ordering::Relaxed) {
                for job in orders.try_iter() {
                    job(&mut stylus);
                }
                stylus.run_for(STEP_NS);
                socket.serve(&mut stylus);
                // On a busy computer, this lets the client run before virtual time continues.
                let begin = Instant::now();
                while socket.is_ahead() && begin.elapsed() < Duration::from_secs(2) {
                    std::thread::sleep(Duration::from_micros(50));
                    socket.serve(&mut stylus);
                }
                clock.store(stylus.now_ns(), Ordering::Relaxed);
                let ran = Duration::from_nanos(stylus.now_ns() - from_ns);
                std::thread::sleep(ran.saturating_sub(began.elapsed()));
            }
            let outputs = stylus.take_dac_record();
            (outputs, stylus.resets())
        });
        Self {
            address: format!("usb-virtual:127.0.0.1:{port}").parse().expect("a link"),
            now_ns,
            ends,
            jobs,
            thread: Some(thread),
        }
    }

    fn connect(&self) -> Device {
        // The client cannot connect until the device has started and is enumerated.
        let begin = Instant::now();
        loop {
            match Device::connect(&self.address, Timeouts::scaled_to(PATIENCE)) {
                Ok(device) => return device,
                Err(failure) if begin.elapsed() > 3 * PATIENCE => panic!("{failure}"),
                Err(_) => std::thread::sleep(Duration::from_millis(100)),
            }
        }
    }

    fn have(&self, job: impl FnOnce(&mut VirtualStylus) + Send + 'static) {
        self.jobs.send(Box::new(job)).expect("it runs");
    }

    fn now_ms(&self) -> u64 {
        self.now_ns.load(Ordering::Relaxed) / MS
    }

    /// Ends the run. Checks that there was no reset, and that codes were put out every 25 µs.
    fn finish(mut self) {
        self.ends.store(true, Ordering::Relaxed);
        let (outputs, resets) = (self.thread.take())
            .map(|thread| thread.join().expect("the run went on"))
            .expect("it ends once");
        assert_eq!(resets, []);
        let triggered = outputs.into_iter().filter(|output| output.cause == Cause::Trigger);
        assert_even(&triggered.collect::<Vec<_>>());
    }
}

#[test]
fn the_client_uploads_plays_records_and_reads_the_status_over_usb() {
    let running = Running::start();
    running.have(|stylus| {
        (stylus.set_motion(Motion::steady(120.0, 0.01)));
    });
    let mut device = running.connect();
    let large = library::middling();
    let begin_ms = running.now_ms();
    let uploaded = upload(&mut device, &large, |_| {}).expect("it is uploaded");
    println!(
        "{} bytes by the client, erasing, writing and reading back: {} ms of virtual time",
        large.len(),
        running.now_ms() - begin_ms
    );
    assert_eq!((uploaded.retries, uploaded.textures.len()), (0, 1));
    device.activate(uploaded.slot).expect("it is activated");
    let request = play_request("texture 0", 3);
    device.play(&request).expect("it plays");
    let plan = Drive {
        motion: None,
        rate_hz: 100,
        // Far longer than it takes: on a busy computer an answer may take seconds.
        duration: Some(Duration::from_mins(10)),
    };
    let is_seen = Cell::new(false);
    let see = |driven: &Driven, status: &Status| {
        let is_playing = status.output.mute == MuteReasons::NONE && driven.keep_alives > 10;
        is_seen.set(is_seen.get() || is_playing);
    };
    drive(&device, &plan, || !is_seen.get(), see).expect("the link holds");
    assert!(is_seen.get(), "no status of a play that goes on");
    let recorded = capture(&device, recording_s() as f64, 0.0, || true, |_, _, _| {})
        .expect("the link holds")
        .expect("nobody stops it");
    assert!(recorded.loss.is_none(), "{}", recorded.loss);
    assert_eq!(recorded.holes, 0);
    assert_eq!(recorded.samples.len(), (recording_s() as f64 * 5_000.0) as usize);
    device.stop().expect("it stops");
    let status = device.status().expect("the link holds");
    assert_eq!(status.tick.missed, 0);
    assert_eq!(
        (status.usb.malformed, status.usb.oversized, status.usb.unsent),
        (0, 0, 0)
    );
    drop(device);
    // Another program must find no leftovers of this one.
    let again = running.connect();
    assert_eq!(again.status().expect("the link holds").tick.missed, 0);
    drop(again);
    running.finish();
}
