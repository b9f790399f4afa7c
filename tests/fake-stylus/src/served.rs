//! A device behind a TCP port, and its clock, which no load of the computer disturbs.
//!
//! The clock follows real time only as far as the host keeps up. Each frame of the host grants the device some time,
//! and at the end of that time the clock waits for the next frame, as if the device had not noticed that the host was
//! late. A play is therefore never muted because this computer did not run the host in time. Time that the device's own
//! thread has lost is not made up for, so that no recording comes in a burst.
//!
//! What needs no host goes on freely: a recording, a job of the storage, and a device that nobody is connected to. A
//! test that is about a silent host, such as the end of a lease, lets time pass by [`FakeStylus::pass`].

use std::net::TcpListener;
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Waker};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use model_format::link::{
    Activity, ImageVersion, LINK_LOST_AFTER_MS, LinkId, MotionSample, MotionSource, MotionTopic, RecordBlock,
    RecordBlockTopic, STALE_AFTER_MS, Status,
};
use postcard_rpc::Topic;
use postcard_rpc::header::{VarHeader, VarKey};
use stylus_app::SAMPLE_RATE_HZ;
use stylus_app::control::Device;
use stylus_app::update::{DEVELOPMENT_KEY, Running, Updates};
use stylus_boot::map::RECORDS;
use stylus_boot::record::{EXCHANGED, Record, Store, mark};

use crate::actuator::Actuator;
use crate::board::Board;
use crate::board::Hand;
use crate::connection::{Connection, Faults};
use crate::device::{Flash, SharedControl, SteppedStylus};
use crate::flash::{Damage, Memory, SimulatedFlash};
use crate::hardware::BOARD;
use crate::requests::{Requests, frame, path_of};

/// Number of steps of the storage's task between two polls of the link. It is bounded so that frames are served during
/// a long job.
const STORAGE_STEPS: usize = 64;

/// Pause of a thread that waits for another.
const PAUSE: Duration = Duration::from_millis(1);

/// Path of a frame that has none.
const UNKNOWN: &str = "?";

/// A frame that arrived.
#[derive(Clone, Debug)]
pub struct HeardFrame {
    /// Path of the frame's endpoint or topic, "?" if there is none.
    pub path: &'static str,
    /// The motion in the frame, if the frame is a motion message without an answer.
    pub motion: Option<MotionSample>,
}

/// An image that a bootloader has started.
#[derive(Clone, Copy, Debug)]
pub struct StartedImage {
    /// Version of the image.
    pub version: ImageVersion,
    /// True if the next reset restores the previous image.
    pub is_on_trial: bool,
}

/// Samples to lose or to tear.
#[derive(Clone, Copy)]
struct Due {
    /// Time from the recording's start to the first of them.
    after: Duration,
    samples: u32,
}

/// State that the test's thread and the device's thread share.
#[derive(Default)]
struct Inner {
    faults: Faults,
    heard: Vec<HeardFrame>,
    hand: Hand,
    place: i64,
    board: Board,
    test_codes: usize,
    /// Words of the slots' flash to damage: the offset of each word, and the kind of damage.
    damage: Vec<(usize, Damage)>,
    lose_samples: Option<Due>,
    tear_samples: Option<Due>,
    connections: usize,
    /// Time since the device's start.
    time: Duration,
    /// Time that the test still lets pass.
    to_pass: Duration,
    is_over: bool,
}

/// A stylus that a host reaches by TCP. It runs in its own thread until it is dropped.
///
/// Its clock follows real time, but waits for a host that is late; see [`FakeStylus::pass`] for tests of a host that is
/// silent.
///
/// The stylus has two links, a serial port and USB. Each serves the host that came first, and closes the connection of
/// another one.
///
/// ```
/// use std::net::TcpStream;
///
/// let stylus = fake_stylus::FakeStylus::start();
/// assert_eq!(stylus.link(), format!("tcp:127.0.0.1:{}", stylus.port()));
/// TcpStream::connect(("127.0.0.1", stylus.port())).expect("it listens");
/// ```
pub struct FakeStylus {
    /// TCP ports of the serial port and of USB.
    ports: [u16; 2],
    inner: Arc<Mutex<Inner>>,
    thread: Option<JoinHandle<()>>,
}

impl FakeStylus {
    /// Boots a stylus on blank flash, sets the settings of its coil, and lets hosts connect.
    pub fn start() -> Self {
        Self::start_with(SteppedStylus::set_coil)
    }

    /// Boots a stylus on blank flash, whose settings nobody has set, and lets hosts connect.
    pub fn start_unset() -> Self {
        Self::start_with(|_| ())
    }

    /// Boots a stylus on blank flash with `actuator` at its output, and lets hosts connect. The settings of the coil
    /// and of the amplifier have the actuator's true values.
    pub fn start_on(actuator: Actuator) -> Self {
        Self::start_with(|stylus| stylus.set_actuator(actuator))
    }

    /// Boots a stylus with a bootloader, and lets hosts connect. After each restart for an update the stylus runs the
    /// next of `images`, again on blank flash.
    pub fn start_updatable(images: Vec<StartedImage>) -> Self {
        Self::start_as(move |listeners, shared| {
            for image in images {
                let updates = updates(image);
                serve(listeners, shared, |stylus| {
                    stylus.set_coil();
                    stylus.storage.set_updates(updates);
                });
            }
        })
    }

    /// Boots a stylus on blank flash, runs `prepare` on it, and lets hosts connect.
    fn start_with(prepare: impl FnOnce(&mut SteppedStylus) + Send + 'static) -> Self {
        Self::start_as(move |listeners, shared| serve(listeners, shared, prepare))
    }

    fn start_as(run: impl FnOnce(&Listeners, &Mutex<Inner>) + Send + 'static) -> Self {
        let listeners = [LinkId::Serial, LinkId::Usb].map(|id| {
            let listener = TcpListener::bind("127.0.0.1:0").expect("a port is free");
            listener.set_nonblocking(true).expect("it can be polled");
            (id, listener)
        });
        let port = |(_, listener): &(_, TcpListener)| listener.local_addr().expect("it is bound");
        let ports = listeners.each_ref().map(|one| port(one).port());
        let inner = Arc::new(Mutex::new(Inner::default()));
        let shared = inner.clone();
        let thread = thread::spawn(move || run(&listeners, &shared));
        Self {
            ports,
            inner,
            thread: Some(thread),
        }
    }

    /// Address of the stylus for `--link` and `host_tools::link`.
    pub fn link(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.port())
    }

    /// Address of the stylus's other link, which is USB to the stylus.
    pub fn other_link(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.ports[1])
    }

    /// TCP port of the stylus.
    pub fn port(&self) -> u16 {
        self.ports[0]
    }

    /// Injects the faults that `set` switches on, starting from none. They replace the faults of the previous call.
    pub fn fail(&self, set: impl FnOnce(&mut Faults)) {
        let mut faults = Faults::default();
        set(&mut faults);
        lock(&self.inner).faults = faults;
    }

    /// Replaces the hand that holds the stylus.
    pub fn set_hand(&self, hand: Hand) {
        lock(&self.inner).hand = hand;
    }

    /// Counts of the stylus's encoder since the start.
    pub fn place(&self) -> i64 {
        lock(&self.inner).place
    }

    /// Time since the device's start, by the device's clock.
    pub fn time(&self) -> Duration {
        lock(&self.inner).time
    }

    /// Lets `time` pass at the device, whatever the host says meanwhile, and waits until it has passed.
    pub fn pass(&self, time: Duration) {
        lock(&self.inner).to_pass += time;
        while !lock(&self.inner).to_pass.is_zero() {
            assert!(!self.thread.as_ref().is_none_or(JoinHandle::is_finished));
            thread::sleep(PAUSE);
        }
    }

    /// Replaces the board that the self test measures.
    pub fn set_board(&self, board: Board) {
        lock(&self.inner).board = board;
    }

    /// Number of codes other than mid-scale that the stylus's self test has put out.
    pub fn test_codes(&self) -> usize {
        lock(&self.inner).test_codes
    }

    /// Damages the word of the slots' flash at `offset`.
    pub fn damage(&self, offset: usize, damage: Damage) {
        lock(&self.inner).damage.push((offset, damage));
    }

    /// Loses `samples` samples of the present or next recording before they reach the recorder, from the time `after`
    /// its start on. A call replaces one that has not begun yet.
    pub fn lose_samples(&self, after: Duration, samples: u32) {
        lock(&self.inner).lose_samples = Some(Due { after, samples });
    }

    /// Tears `samples` samples, at a time like [`FakeStylus::lose_samples`]: not all of their conversions belong to
    /// their tick.
    pub fn tear_samples(&self, after: Duration, samples: u32) {
        lock(&self.inner).tear_samples = Some(Due { after, samples });
    }

    /// Returns the frames that have arrived since the last call, and forgets them.
    pub fn take_heard(&self) -> Vec<HeardFrame> {
        std::mem::take(&mut lock(&self.inner).heard)
    }

    /// Number of frames for `path` that have arrived since [`FakeStylus::take_heard`].
    pub fn count(&self, path: &str) -> usize {
        lock(&self.inner)
            .heard
            .iter()
            .filter(|heard| heard.path == path)
            .count()
    }

    /// Number of connections so far.
    pub fn connections(&self) -> usize {
        lock(&self.inner).connections
    }
}

impl Drop for FakeStylus {
    fn drop(&mut self) {
        lock(&self.inner).is_over = true;
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join)
            && !thread::panicking()
        {
            std::panic::resume_unwind(panic);
        }
    }
}

/// Locks the shared state. A poisoned lock is accepted, because [`FakeStylus::drop`] reports the panic of the other
/// thread.
fn lock(inner: &Mutex<Inner>) -> MutexGuard<'_, Inner> {
    inner.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the update state of a device that runs `image` and trusts the development key.
fn updates(image: StartedImage) -> Updates<Flash> {
    let record = if image.is_on_trial {
        let mut record = Record::marked(mark::SWAP, 0, image.version.numbers());
        // The exchange of the images is complete.
        record.marks[2..2 + EXCHANGED].fill(0);
        record
    } else {
        Record::NONE
    };
    let flash = SimulatedFlash::new(Memory::blank(RECORDS.end as usize));
    let store = embassy_futures::block_on(async {
        let mut store = Store::open(flash, RECORDS).await;
        store.replace(record).await.expect("the flash is new");
        store
    });
    let running = Running {
        board: BOARD,
        image: image.version,
        bootloader: image.version,
        key: DEVELOPMENT_KEY,
        takes_unsigned: false,
    };
    Updates::new(store, running)
}

/// Longest step of the clock, even if the device's thread was not run for longer.
const LONGEST_STEP: Duration = Duration::from_millis(5);

/// Time that a motion grants. With it and [`OTHER_GRANT`] for a status after each, there are more than 60 motions per
/// second of the clock, the least that a play may have.
const MOTION_GRANT: Duration = Duration::from_millis(14);

/// Time that a keep-alive grants a device that plays without motions of the host. A host sends several of them in this
/// time, each when it has received blocks of a recording.
const KEEP_ALIVE_GRANT: Duration = Duration::from_millis(40);

/// Time that a keep-alive grants while motions are due: the interval in which a host sends keep-alives.
const KEEP_ALIVE_WITHOUT_MOTION_GRANT: Duration = Duration::from_millis(10);

/// Time that any other frame grants while a host holds the lease. It is short, because such a frame renews nothing.
const OTHER_GRANT: Duration = Duration::from_millis(2);

/// Time that a frame grants a device at which no host holds the lease.
const IDLE_GRANT: Duration = Duration::from_millis(10);

const _: () = assert!(
    MOTION_GRANT.as_millis() < STALE_AFTER_MS as u128 && KEEP_ALIVE_GRANT.as_millis() < LINK_LOST_AFTER_MS as u128
);

/// The clock of a device behind a connection.
struct Clock {
    /// Time since the device's start.
    time: Duration,
    /// Instant at which the clock was last set.
    set_at: Instant,
    /// End of the time that the host's frames have granted.
    granted: Duration,
    /// Link whose present connection was the last that asked to play. A lease of an earlier connection is not waited
    /// for.
    player: Option<LinkId>,
}

impl Clock {
    /// Creates a clock that shows `time`.
    fn new(time: Duration) -> Self {
        Self {
            time,
            set_at: Instant::now(),
            granted: time,
            player: None,
        }
    }

    /// Time since the device's start.
    fn time(&self) -> Duration {
        self.time
    }

    /// Begins a connection on the link `id`, whose host has not said anything yet.
    fn connect(&mut self, id: LinkId) {
        self.granted = self.time;
        self.end(id);
    }

    /// Ends the connection on the link `id`.
    fn end(&mut self, id: LinkId) {
        self.player.take_if(|player| *player == id);
    }

    /// Grants the time that belongs to a frame for `path` on the link `id`, which has left the device with `status`.
    fn hear(&mut self, id: LinkId, path: &str, status: &Status) {
        if matches!(path, "stylus/play" | "stylus/probe/start") {
            self.player = Some(id);
        }
        let follows_host = matches!(
            status.output.activity,
            Activity::Playing {
                motion: MotionSource::Host,
                ..
            }
        );
        let grant = match path {
            _ if !self.is_held(status) => IDLE_GRANT,
            "stylus/motion" | "stylus/motion/live" => MOTION_GRANT,
            "stylus/play" | "stylus/keep-alive" if follows_host => KEEP_ALIVE_WITHOUT_MOTION_GRANT,
            "stylus/play" | "stylus/probe/start" | "stylus/keep-alive" => KEEP_ALIVE_GRANT,
            _ => OTHER_GRANT,
        };
        self.granted = self.granted.max(self.time + grant);
    }

    /// Returns true while a connected host holds the lease.
    fn is_held(&self, status: &Status) -> bool {
        self.player.is_some() && status.lease.is_alive
    }

    /// Lets the clock go on with real time. Unless the device `is_free` of its host, the clock waits at the end of the
    /// granted time while the host holds the lease, or while nothing is recorded.
    fn follow(&mut self, status: &Status, is_free: bool) {
        let now = Instant::now();
        let step = (now - std::mem::replace(&mut self.set_at, now)).min(LONGEST_STEP);
        let next = self.time + step;
        let waits = !is_free && (self.is_held(status) || !status.record.recording);
        self.time = if waits {
            next.min(self.granted).max(self.time)
        } else {
            next
        };
    }

    /// Lets up to `time` pass, whatever the host does. Returns how much has passed.
    fn pass(&mut self, time: Duration) -> Duration {
        let step = time.min(LONGEST_STEP);
        self.time += step;
        step
    }
}

/// The ports of the stylus's links.
type Listeners = [(LinkId, TcpListener); 2];

/// A link of the stylus, with the connection of the host that has it.
struct Wire<'a> {
    id: LinkId,
    listener: &'a TcpListener,
    connection: Option<Connection>,
}

impl Wire<'_> {
    /// Accepts the connection of a host that has connected, if no other host is connected.
    fn accept(&mut self, shared: &Mutex<Inner>, clock: &mut Clock) {
        if self.connection.as_ref().is_some_and(|open| !open.is_open()) {
            self.connection = None;
            clock.end(self.id);
        }
        let Ok((stream, _)) = self.listener.accept() else {
            return;
        };
        // A host that has ended frees its link, even if the stylus has not noticed the end yet.
        if !self.connection.as_mut().is_some_and(Connection::is_held) {
            lock(shared).connections += 1;
            self.connection = Some(Connection::new(stream));
            clock.connect(self.id);
        }
    }
}

/// Serves until the end of the test or until the restart for an update.
fn serve(listeners: &Listeners, shared: &Mutex<Inner>, prepare: impl FnOnce(&mut SteppedStylus)) {
    let slots = SimulatedFlash::two_slots();
    let fate = slots.fate.clone();
    let mut stylus = SteppedStylus::boot_from(slots);
    prepare(&mut stylus);
    let (control, mut storage) = (stylus.control, stylus.storage);
    let requests = Requests::new(control.clone());
    let mut storage = pin!(requests.serve_storage(&mut storage));
    let mut context = Context::from_waker(Waker::noop());
    let mut clock = Clock::new(time(&control));
    let mut recorded = Duration::ZERO;
    let mut is_busy = false;
    let mut wires = listeners.each_ref().map(|(id, listener)| Wire {
        id: *id,
        listener,
        connection: None,
    });
    while set_scene(&control, shared) {
        for wire in &mut wires {
            wire.accept(shared, &mut clock);
        }
        for (offset, damage) in std::mem::take(&mut lock(shared).damage) {
            fate.damage(offset, damage);
        }
        let faults = lock(shared).faults.clone();
        let to_pass = lock(shared).to_pass;
        let passed = clock.pass(to_pass);
        let is_alone = wires.iter().all(|wire| wire.connection.is_none());
        let is_free = is_alone || requests.is_storage_busy();
        clock.follow(&control.borrow().status(), is_free);
        let blocks = catch_up(&control, clock.time(), &faults, shared, &mut recorded);
        lock(shared).to_pass -= passed;
        let frames = wires
            .each_mut()
            .map(|wire| wire.connection.as_mut().map_or_else(Vec::new, Connection::receive));
        // A connection is read with a timeout; without one the loop would use a whole core.
        if is_alone {
            thread::sleep(PAUSE);
        }
        // Read again, because the test may have changed the faults during the wait for frames.
        let faults = lock(shared).faults.clone();
        control.borrow_mut().device().disguise = faults.disguise;
        let mut step = || {
            for _ in 0..STORAGE_STEPS {
                let _ = storage.as_mut().poll(&mut context);
                if !requests.is_storage_busy() {
                    break;
                }
            }
            requests.take_answers()
        };
        send_blocks(&mut wires, &blocks, &faults);
        for (index, frames) in frames.into_iter().enumerate() {
            for bytes in frames {
                let path = note(shared, &bytes);
                is_busy = faults.busy_from.is_some_and(|from| is_busy || path == from);
                let id = wires[index].id;
                let answer = requests.serve(id, &bytes, is_busy);
                clock.hear(id, path, &control.borrow().status());
                let answers = step().into_iter().chain(answer.map(|answer| (id, answer)));
                // The connection that closes with this frame receives no answer any more.
                let open = wires[index].connection.as_mut();
                let is_open = open.is_some_and(|open| open.count_frame(&faults));
                answer_all(&mut wires, answers, &faults);
                if !is_open {
                    break;
                }
            }
        }
        // Jobs go on without a connection, but nobody receives the answers.
        answer_all(&mut wires, step().into_iter(), &faults);
        let open = wires.iter_mut().filter_map(|wire| wire.connection.as_mut());
        open.for_each(|open| open.flush(&faults));
        let mut open = wires.iter().filter_map(|wire| wire.connection.as_ref());
        if requests.wants_restart() && open.all(Connection::has_sent_all) {
            return;
        }
    }
}

/// Queues answers on the links that they go to. Nobody receives the answers of a link without an open connection.
fn answer_all(wires: &mut [Wire<'_>; 2], answers: impl Iterator<Item = (LinkId, Vec<u8>)>, faults: &Faults) {
    for (id, answer) in answers {
        if let Some(open) = connection_of(wires, id) {
            open.answer(&answer, faults);
        }
    }
}

fn connection_of<'a>(wires: &'a mut [Wire<'_>; 2], id: LinkId) -> Option<&'a mut Connection> {
    let mut wires = wires.iter_mut();
    wires
        .find(|wire| wire.id == id)?
        .connection
        .as_mut()
        .filter(|open| open.is_open())
}

/// Time since the device's start.
fn time(control: &SharedControl) -> Duration {
    let ticks = control.borrow_mut().device().now();
    Duration::from_micros(ticks * 1_000_000 / u64::from(SAMPLE_RATE_HZ))
}

/// Gives the device what the test has set (hand, board), and gives the test the device's time, its place and its number
/// of test codes. Returns false if the device must end.
fn set_scene(control: &SharedControl, shared: &Mutex<Inner>) -> bool {
    let mut inner = lock(shared);
    inner.time = time(control);
    let mut control = control.borrow_mut();
    let device = control.device();
    device.hand = inner.hand.clone();
    inner.place = device.place;
    inner.test_codes = device.test_codes;
    device.board = inner.board.clone();
    !inner.is_over
}

/// Runs the device until its clock shows `end`, and returns the blocks that were recorded. `recorded` is the time since
/// the recording's start, if there is a recording.
fn catch_up(
    control: &SharedControl,
    end: Duration,
    faults: &Faults,
    shared: &Mutex<Inner>,
    recorded: &mut Duration,
) -> Vec<(LinkId, RecordBlock)> {
    let mut blocks = Vec::new();
    while time(control) < end {
        let mut device = control.borrow_mut();
        if faults.ignores_lost_link {
            device.keep_alive(LinkId::Serial);
        }
        let hardware = device.device();
        hardware.missed += u32::from(faults.misses_ticks);
        hardware.late_outputs += u32::from(faults.puts_out_late);
        hardware.slower_by = faults.slower_by;
        if hardware.record_counters().recording {
            let inner = &mut *lock(shared);
            let due = |samples: &mut Option<Due>| {
                let due = samples.take_if(|due| due.after <= *recorded);
                due.map_or(0, |due| due.samples)
            };
            hardware.lose_samples += due(&mut inner.lose_samples);
            hardware.tear_samples += due(&mut inner.tear_samples);
            *recorded += Duration::from_millis(1);
        } else {
            *recorded = Duration::ZERO;
        }
        drop(device);
        blocks.extend(control.millisecond());
    }
    blocks
}

fn send_blocks(wires: &mut [Wire<'_>; 2], blocks: &[(LinkId, RecordBlock)], faults: &Faults) {
    for (id, block) in blocks {
        let frame = frame(RecordBlockTopic::TOPIC_KEY, block.sequence, block);
        if let Some(open) = connection_of(wires, *id) {
            open.block(&frame, faults);
        }
    }
}

/// Notes a frame that has arrived, and returns its path.
fn note(shared: &Mutex<Inner>, bytes: &[u8]) -> &'static str {
    let Some((header, body)) = VarHeader::take_from_slice(bytes) else {
        return UNKNOWN;
    };
    let path = path_of(&header).unwrap_or(UNKNOWN);
    let is_motion = header.key == VarKey::Key8(MotionTopic::TOPIC_KEY);
    lock(shared).heard.push(HeardFrame {
        path,
        motion: is_motion.then(|| postcard::from_bytes(body).ok()).flatten(),
    });
    path
}
