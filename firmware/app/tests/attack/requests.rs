//! Interleavings of the requests of two hosts on two links, which do not wait for answers, with the storage's task, the
//! poll and the tick.
//!
//! The application is the device's own, on the shared fake hardware. An executor chooses at each await which task goes
//! on. [`REQUESTS`] is the list of requests: a new one is covered by a line in it, and a new await by itself, because
//! every one of them is a point at which the executor chooses.
//!
//! Held at each point: see [`Watch`]. Held at the end: every request was answered once, and the device plays again.
//!
//! - All schedules of each pair of requests, up to a bound of time, are explored. States that were seen are not entered
//!   again; two states are the same if they have the same [`World::fingerprint`].
//! - Longer lists of requests run under random schedules, in which ticks and polls are late by up to a millisecond.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::pin::Pin;
use std::sync::LazyLock;
use std::task::{Context, Waker};

use embassy_futures::block_on;
use fake_stylus::device::{COIL, Omission, SharedControl, SteppedStylus};
use fake_stylus::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, put, small_of};
use fake_stylus::requests::{Requests, frame};
use model_format::limits::SLOT_BYTES;
use model_format::link::{
    ActivateEndpoint, Activity, CyclesEndpoint, InfoEndpoint, KeepAliveTopic, ListEndpoint,
    ListRequest, ListSceneEndpoint, MotionEndpoint, MotionSample, MotionSource, MotionTopic,
    PlayEndpoint, PlayRequest, RecordStartEndpoint, RecordStopEndpoint, Selection,
    SelfTestEndpoint, SelfTestRequest, Setting, SettingChange, Settings, SettingsGetEndpoint,
    SettingsResetEndpoint, SettingsSetEndpoint, SlotId, SlotsEndpoint, StatusEndpoint,
    StopEndpoint, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk,
    UploadChunkEndpoint, UploadCommitEndpoint, UploadProgressEndpoint,
};
use model_format::{MillimetresPerSecond, Newton};
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use postcard_rpc::standard_icd::PingEndpoint;
use postcard_rpc::{Endpoint, Key, Topic};
use serde::Serialize;
use stylus_app::TICKS_PER_MS;
use stylus_app::control::Device;
use stylus_app::safety::Config;
use stylus_app::settings::SettingsStore;

use crate::budget::{self, Chance};

/// Time within which the output is silent after a mute begins, ticks: 100 ms, and the lateness of the poll.
const SILENT_WITHIN_TICKS: u64 = (100 * TICKS_PER_MS) as u64 + LATEST_POLL_TICKS;

/// Ticks after which the poll comes at the latest, under random schedules.
const LATEST_POLL_TICKS: u64 = 2 * TICKS_PER_MS as u64;

/// Time after which nothing may be under way any more, ms: an activation waits 500 ms for rest.
const SETTLED_AFTER_MS: u32 = 1_500;

/// Choices of a random schedule after which it counts as endless.
const MOST_CHOICES: usize = 200_000;

/// Frame of a request with the given sequence number.
type Made = fn(u32) -> Vec<u8>;

/// A request: its name, and its frame.
#[derive(Clone, Copy)]
struct Request {
    name: &'static str,
    make: Made,
    /// True if it is answered.
    answered: bool,
}

const fn asked(name: &'static str, make: Made) -> Request {
    Request {
        name,
        make,
        answered: true,
    }
}

const fn told(name: &'static str, make: Made) -> Request {
    Request {
        name,
        make,
        answered: false,
    }
}

/// All requests. Those that come first change what is played or stored, and are paired with each other exhaustively.
const REQUESTS: &[Request] = &[
    asked("play", |n| ask::<PlayEndpoint>(n, &play("texture 0", 1.0))),
    asked("play another texture", |n| {
        ask::<PlayEndpoint>(n, &play("texture 1", 1.0))
    }),
    asked("play with another gain", |n| {
        ask::<PlayEndpoint>(n, &play("texture 0", 0.25))
    }),
    asked("stop", |n| ask::<StopEndpoint>(n, &())),
    asked("set a limit", |n| {
        ask::<SettingsSetEndpoint>(n, &set(Setting::HardLimit, 0.25))
    }),
    asked("set what the coil needs", |n| {
        ask::<SettingsSetEndpoint>(n, &set(Setting::AmplifierGain, 2.0))
    }),
    asked("reset the settings", |n| {
        ask::<SettingsResetEndpoint>(n, &())
    }),
    asked("activate A", |n| ask::<ActivateEndpoint>(n, &SlotId::A)),
    asked("activate B", |n| ask::<ActivateEndpoint>(n, &SlotId::B)),
    asked("begin an upload", |n| {
        ask::<UploadBeginEndpoint>(n, &announcement(&LIBRARIES[2]))
    }),
    asked("self test of a slot", |n| {
        let request = SelfTestRequest::Flash {
            slot: SlotId::B,
            erases_library: true,
        };
        ask::<SelfTestEndpoint>(n, &request)
    }),
    asked("self test of the output", |n| {
        ask::<SelfTestEndpoint>(n, &SelfTestRequest::Output)
    }),
    // From here on: in random lists alone.
    asked("begin another upload", |n| {
        let begin = UploadBegin {
            replaces_last: true,
            ..announcement(&LIBRARIES[1])
        };
        ask::<UploadBeginEndpoint>(n, &begin)
    }),
    asked("the only chunk", |n| chunk(n, 0, usize::MAX)),
    asked("first chunk", |n| chunk(n, 0, HALF)),
    asked("second chunk", |n| chunk(n, HALF, usize::MAX)),
    asked("commit", |n| ask::<UploadCommitEndpoint>(n, &())),
    asked("abort", |n| ask::<UploadAbortEndpoint>(n, &())),
    asked("progress", |n| ask::<UploadProgressEndpoint>(n, &())),
    asked("slots", |n| ask::<SlotsEndpoint>(n, &())),
    asked("list", |n| ask::<ListEndpoint>(n, &first_of(SlotId::A))),
    asked("list scenes", |n| {
        ask::<ListSceneEndpoint>(n, &first_of(SlotId::B))
    }),
    asked("set a value out of range", |n| {
        ask::<SettingsSetEndpoint>(n, &set(Setting::HardLimit, 99.0))
    }),
    asked("settings", |n| ask::<SettingsGetEndpoint>(n, &())),
    asked("play by the sensors", |n| {
        let request = PlayRequest {
            motion: MotionSource::Sensors,
            ..play("texture 0", 1.0)
        };
        ask::<PlayEndpoint>(n, &request)
    }),
    asked("play what is not there", |n| {
        ask::<PlayEndpoint>(n, &play("nothing", 1.0))
    }),
    asked("motion", |n| ask::<MotionEndpoint>(n, &motion())),
    told("live motion", |n| tell::<MotionTopic>(n, &motion())),
    told("keep alive", |n| tell::<KeepAliveTopic>(n, &())),
    asked("record", |n| ask::<RecordStartEndpoint>(n, &())),
    asked("end of the recording", |n| {
        ask::<RecordStopEndpoint>(n, &())
    }),
    asked("self test of the chip", |n| {
        ask::<SelfTestEndpoint>(n, &SelfTestRequest::Chip)
    }),
    asked("status", |n| ask::<StatusEndpoint>(n, &())),
    asked("cycles", |n| ask::<CyclesEndpoint>(n, &())),
    asked("info", |n| ask::<InfoEndpoint>(n, &())),
    asked("ping", |n| ask::<PingEndpoint>(n, &7)),
    asked("a request without its body", |n| {
        frame(PlayEndpoint::REQ_KEY, header(n), &())
    }),
    asked("an unknown request", |n| {
        frame(Key::for_path::<()>("nowhere"), header(n), &())
    }),
];

/// Bytes of the first chunk of an upload in two.
const HALF: usize = 64;

/// Number of the requests that are paired exhaustively.
const PAIRED: usize = 12;

/// The libraries in slots A and B, and one to upload. The names of their textures are the same.
static LIBRARIES: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
    [1, 2, 3].map(|seed| {
        let bytes = small_of(&["texture 0", "texture 1"], seed);
        assert!(HALF < bytes.len() && bytes.len() < 512);
        bytes
    })
});

fn header(number: u32) -> VarHeader {
    VarHeader {
        key: VarKey::Key8(PingEndpoint::REQ_KEY),
        seq_no: VarSeq::Seq4(number),
    }
}

fn ask<E: Endpoint>(number: u32, request: &impl Serialize) -> Vec<u8> {
    frame(E::REQ_KEY, header(number), request)
}

fn tell<T: Topic>(number: u32, message: &impl Serialize) -> Vec<u8> {
    frame(T::TOPIC_KEY, header(number), message)
}

fn play(texture: &str, gain: f32) -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture(texture.try_into().expect("it is short")),
        gain,
        motion: MotionSource::Host,
        seed: 1,
    }
}

fn set(setting: Setting, value: f32) -> SettingChange {
    SettingChange { setting, value }
}

fn first_of(slot: SlotId) -> ListRequest {
    ListRequest { slot, index: 0 }
}

fn motion() -> MotionSample {
    MotionSample {
        speed: MillimetresPerSecond(100.0),
        force: Newton(1.0),
        position_mm: None,
        contact: None,
    }
}

fn chunk(number: u32, offset: usize, end: usize) -> Vec<u8> {
    let bytes = &LIBRARIES[2];
    let data = &bytes[offset..bytes.len().min(end)];
    let offset = offset as u32;
    ask::<UploadChunkEndpoint>(number, &UploadChunk { offset, data })
}

/// Settings in flash: the coil's, and ramps as short as they can be if `brief`, so that few states differ in time.
fn stored_settings(brief: bool) -> Memory {
    let mut flash = SimulatedFlash::new(Memory::blank(2 * SECTOR_BYTES));
    let range = 0..2 * SECTOR_BYTES as u32;
    let mut store = block_on(SettingsStore::open(&mut flash, range));
    let ramps = [Setting::MuteRamp, Setting::SoftStart].map(|ramp| set(ramp, ramp.spec().lowest));
    for change in COIL.into_iter().chain(ramps.into_iter().filter(|_| brief)) {
        block_on(store.set(change)).expect("it is in range");
    }
    flash.memory
}

/// Flashes of slots and settings at the beginning: a library in each slot, A being the newer one.
struct Beginning {
    slots: Memory,
    settings: Memory,
}

impl Beginning {
    fn new(brief: bool) -> Self {
        let mut slots = Memory::blank(2 * SLOT_BYTES);
        put(&mut slots, SlotId::A, &LIBRARIES[0], 2);
        put(&mut slots, SlotId::B, &LIBRARIES[1], 1);
        Self {
            slots,
            settings: stored_settings(brief),
        }
    }
}

/// The task that goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Choice {
    /// The link of this host serves its next frame.
    Host(usize),
    /// The storage goes on to its next await.
    Storage,
    /// A millisecond: its ticks, then the poll.
    Millisecond,
    /// Milliseconds until something changes that requests can tell, or many have passed.
    Wait,
    /// One tick.
    Tick,
    /// The poll.
    Poll,
}

type Checked = Result<(), String>;

/// Observations that must hold at every point.
struct Watch {
    settings: Settings,
    muted_since: Option<u64>,
    polled_at: u64,
}

impl Watch {
    fn new(control: &SharedControl) -> Self {
        let mut control = control.borrow_mut();
        Self {
            settings: control.settings(),
            muted_since: None,
            polled_at: control.device().now(),
        }
    }

    fn look(&mut self, control: &SharedControl) -> Checked {
        let mut control = control.borrow_mut();
        let mute = control.mute();
        let state = control.status().settings;
        let settings = control.settings();
        let active = control.active();
        let hardware: &mut Hardware = control.device();
        let now = hardware.now();
        if settings != self.settings {
            if hardware.playing.is_some() || hardware.sounds() {
                return Err("settings changed while something plays".to_owned());
            }
            self.settings = settings;
        }
        if hardware.settings != settings {
            return Err("the device has other settings than the application".to_owned());
        }
        let gain = hardware
            .playing
            .as_ref()
            .map_or(1.0, |playing| playing.gain);
        let may_linger = hardware.playing.is_none();
        if !may_linger && hardware.config != Config::new(&settings, gain) {
            return Err("what sounds has another gain than it was played with".to_owned());
        }
        if mute.is_empty() {
            self.muted_since = None;
        } else {
            let since = *self.muted_since.get_or_insert(now);
            if now - since > SILENT_WITHIN_TICKS && hardware.sounds() {
                return Err(format!("it sounds {} ticks after a mute", now - since));
            }
        }
        if hardware.is_muted() == mute.is_empty() {
            return Err("the tick was told another mute than the status tells".to_owned());
        }
        let amplifier = hardware.tick_report().amplifier;
        let may_be_on = state.check_playable().is_ok() && !hardware.start.safe_mode;
        if amplifier && !may_be_on {
            return Err("the amplifier is on without the coil's settings".to_owned());
        }
        if hardware.playing.is_some() && (active.is_none() || !may_be_on) {
            return Err("something plays without library or settings".to_owned());
        }
        Ok(())
    }
}

/// A host: its frames that were not sent yet.
struct Host {
    requests: Vec<Request>,
    sent: usize,
}

/// A device, its tasks, and two hosts.
struct World {
    control: SharedControl,
    requests: Requests,
    storage: Pin<Box<dyn Future<Output = ()>>>,
    /// Steps of the storage since it was last idle.
    storage_steps: u32,
    hosts: [Host; 2],
    /// Number of answers per sequence number.
    answers: Vec<u32>,
    expected: Vec<bool>,
    watch: Watch,
    /// Waits while a task could have gone on.
    waits: u32,
    heard_at: u64,
    schedule: Vec<Choice>,
}

/// Longest wait for a change, ms.
const LONGEST_WAIT_MS: u32 = 60;

impl World {
    fn new(beginning: &Beginning, lists: [&[Request]; 2], plays: bool, omission: Omission) -> Self {
        let stylus = SteppedStylus::boot_with(
            SimulatedFlash::new(beginning.slots.clone()),
            SimulatedFlash::new(beginning.settings.clone()),
        );
        let SteppedStylus {
            control,
            mut storage,
        } = stylus;
        let requests = Requests::new(control.without(omission));
        let served = requests.clone();
        let mut world = Self {
            watch: Watch::new(&control),
            control,
            requests,
            storage: Box::pin(async move { served.serve_storage(&mut storage).await }),
            storage_steps: 0,
            hosts: lists.map(|list| Host {
                requests: list.to_vec(),
                sent: 0,
            }),
            answers: Vec::new(),
            expected: Vec::new(),
            waits: 0,
            heard_at: 0,
            schedule: Vec::new(),
        };
        if plays {
            world.serve(REQUESTS[0]);
            for _ in 0..8 {
                world.millisecond().expect("it plays alone");
            }
        }
        world
    }

    /// Serves a request of either host.
    fn serve(&mut self, request: Request) {
        let number = self.expected.len() as u32;
        self.note_heard();
        self.expected.push(request.answered);
        self.answers.push(0);
        let frame = (request.make)(number);
        if let Some(answer) = self.requests.serve(&frame, false) {
            self.count(&answer);
        }
    }

    fn count(&mut self, answer: &[u8]) {
        let header = VarHeader::take_from_slice(answer).map(|(header, _)| header);
        let number = match header.expect("an answer has a header").seq_no {
            VarSeq::Seq1(number) => number.into(),
            VarSeq::Seq2(number) => number.into(),
            VarSeq::Seq4(number) => number,
        };
        self.answers[number as usize] += 1;
    }

    fn is_done(&self) -> bool {
        self.hosts
            .iter()
            .all(|host| host.sent == host.requests.len())
            && !self.requests.is_storage_busy()
    }

    /// The tasks that can go on, of those that need no time.
    fn ready(&self) -> impl Iterator<Item = Choice> + use<> {
        let hosts = [0, 1].map(|index| {
            let host = &self.hosts[index];
            (host.sent < host.requests.len()).then_some(Choice::Host(index))
        });
        let storage = (self.requests.is_storage_busy() && !self.control.is_storage_waiting())
            .then_some(Choice::Storage);
        hosts.into_iter().chain([storage]).flatten()
    }

    fn go_on(&mut self, choice: Choice) -> Checked {
        self.schedule.push(choice);
        match choice {
            Choice::Host(index) => {
                let host = &mut self.hosts[index];
                let request = host.requests[host.sent];
                host.sent += 1;
                self.serve(request);
            }
            Choice::Storage => self.storage_goes_on(),
            Choice::Millisecond => self.millisecond()?,
            Choice::Wait => {
                self.waits += 1;
                let before = self.fingerprint();
                for _ in 0..LONGEST_WAIT_MS {
                    self.millisecond()?;
                    if self.requests.is_storage_busy() {
                        self.storage_goes_on();
                    }
                    if self.fingerprint() != before {
                        break;
                    }
                }
            }
            Choice::Tick => self.control.borrow_mut().device().tick(),
            Choice::Poll => {
                let mut control = self.control.borrow_mut();
                control.poll();
                self.watch.polled_at = control.device().now();
            }
        }
        self.watch.look(&self.control)?;
        let mut control = self.control.borrow_mut();
        let now = control.device().now();
        if now - self.heard_at > SILENT_WITHIN_TICKS && control.device().sounds() {
            return Err("it sounds although no host was heard".to_owned());
        }
        Ok(())
    }

    fn storage_goes_on(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        let _ = self.storage.as_mut().poll(&mut context);
        for answer in self.requests.take_answers() {
            self.count(&answer);
        }
        // While it waits it is where it was.
        self.storage_steps += u32::from(!self.control.is_storage_waiting());
        if !self.requests.is_storage_busy() {
            self.storage_steps = 0;
        }
    }

    /// A millisecond in which a host sends a motion.
    fn millisecond(&mut self) -> Checked {
        self.note_heard();
        self.control.millisecond_with_motion();
        self.watch.polled_at = self.heard_at + u64::from(TICKS_PER_MS);
        self.watch.look(&self.control)
    }

    fn note_heard(&mut self) {
        self.heard_at = self.control.borrow_mut().device().now();
    }

    /// All of the state by which later steps can differ. Of time it keeps what the application does.
    fn fingerprint(&self) -> String {
        let mut print = String::new();
        let mut control = self.control.borrow_mut();
        let status = control.status();
        let hardware = control.device();
        let output = status.output;
        let _ = write!(
            print,
            "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {} {} {:?} {} {}",
            output.activity,
            output.mute,
            output.at_rest,
            status.active,
            status.upload,
            status.settings,
            hardware.playing,
            hardware.prepared,
            hardware.config,
            hardware.sounds(),
            hardware.is_muted(),
            self.hosts.each_ref().map(|host| host.sent),
            self.storage_steps,
            self.expected.len(),
        );
        let _ = write!(print, "{:?}", self.answers);
        print
    }

    /// Runs to the end of all requests, and checks it.
    fn end(&mut self) -> Checked {
        let mut waited_ms = 0;
        while !self.is_done() {
            if waited_ms > SETTLED_AFTER_MS {
                return Err("a request is never done".to_owned());
            }
            // A request for flash goes on many times per millisecond.
            for _ in 0..16 {
                if let Some(choice) = self.ready().next() {
                    self.go_on(choice)?;
                }
            }
            self.go_on(Choice::Millisecond)?;
            waited_ms += 1;
        }
        for (number, (&count, &answered)) in self.answers.iter().zip(&self.expected).enumerate() {
            if count != u32::from(answered) {
                return Err(format!("request {number} was answered {count} times"));
            }
        }
        Ok(())
    }

    /// Serves `request`, and lets the device run until it is done.
    fn do_alone(&mut self, request: Request) -> Checked {
        self.hosts[0].requests.push(request);
        self.end()
    }

    /// After the end of all requests: the device stops, and plays again.
    fn plays_again(&mut self) -> Checked {
        let named = |name| {
            let found = REQUESTS.iter().find(|request| request.name == name);
            *found.expect("it is in the list")
        };
        self.do_alone(named("stop"))?;
        for _ in 0..110 {
            self.go_on(Choice::Millisecond)?;
        }
        let mut control = self.control.borrow_mut();
        let activity = control.status().output.activity;
        let sounds = control.device().sounds();
        drop(control);
        if sounds || activity != Activity::Idle {
            return Err(format!(
                "after a stop it is {activity:?}, sounding: {sounds}"
            ));
        }
        if self
            .control
            .borrow()
            .status()
            .settings
            .check_playable()
            .is_err()
        {
            for make in [
                (|n| ask::<SettingsSetEndpoint>(n, &COIL[0])) as Made,
                |n| ask::<SettingsSetEndpoint>(n, &COIL[1]),
                |n| ask::<SettingsSetEndpoint>(n, &COIL[2]),
            ] {
                self.do_alone(asked("a setting of the coil", make))?;
            }
        }
        if self.control.borrow().active().is_none() {
            self.do_alone(named("activate A"))?;
        }
        if self.control.borrow().active().is_none() {
            self.do_alone(named("activate B"))?;
        }
        let starts = self.control.borrow_mut().device().starts;
        self.do_alone(named("play"))?;
        for _ in 0..60 {
            self.go_on(Choice::Millisecond)?;
        }
        let mut control = self.control.borrow_mut();
        let mute = control.mute();
        let hardware = control.device();
        if hardware.starts == starts || !hardware.sounds() || !mute.is_empty() {
            return Err(format!("it does not play again: {mute:?}"));
        }
        Ok(())
    }
}

/// Two lists of requests, and a beginning.
#[derive(Clone, Copy)]
struct Scenario<'a> {
    beginning: &'a Beginning,
    lists: [&'a [Request]; 2],
    plays: bool,
    omission: Omission,
}

impl Scenario<'_> {
    fn world(&self) -> World {
        World::new(self.beginning, self.lists, self.plays, self.omission)
    }

    fn told(&self, world: &World, problem: &str) -> String {
        let names = self
            .lists
            .map(|list| list.iter().map(|request| request.name).collect::<Vec<_>>());
        format!(
            "{problem}\n{names:?}, playing before: {}, {:?}",
            self.plays, world.schedule
        )
    }

    /// Explores all schedules in which time passes at most `waits` times while a task could go on, and returns the
    /// number of states.
    fn explore(&self, waits: u32) -> Result<usize, String> {
        let mut seen = HashSet::new();
        let mut ends = HashSet::new();
        let mut open: Vec<Vec<Choice>> = vec![Vec::new()];
        while let Some(prefix) = open.pop() {
            let mut world = self.world();
            let explored = follow(&mut world, &prefix, waits, &mut seen, &mut ends, &mut open);
            explored.map_err(|problem| self.told(&world, &problem))?;
        }
        Ok(seen.len())
    }

    /// Runs one random schedule.
    fn wander(&self, chance: &mut Chance) -> Checked {
        let mut world = self.world();
        let wandered = wander(&mut world, chance);
        wandered.map_err(|problem| self.told(&world, &problem))
    }
}

/// Follows `prefix`, then takes the first choice at each point and leaves the others in `open`.
fn follow(
    world: &mut World,
    prefix: &[Choice],
    waits: u32,
    seen: &mut HashSet<String>,
    ends: &mut HashSet<String>,
    open: &mut Vec<Vec<Choice>>,
) -> Checked {
    for &choice in prefix {
        world.go_on(choice)?;
    }
    while !world.is_done() {
        if !seen.insert(format!("{} {}", world.waits, world.fingerprint())) {
            return Ok(());
        }
        let mut choices: Vec<_> = world.ready().collect();
        if choices.is_empty() {
            // The storage waits for rest, and nothing else is to be done.
            break;
        }
        if world.waits < waits {
            choices.push(Choice::Wait);
        }
        for &other in &choices[1..] {
            let mut branch = world.schedule.clone();
            branch.push(other);
            open.push(branch);
        }
        world.go_on(choices[0])?;
    }
    world.end()?;
    if ends.insert(world.fingerprint()) {
        world.plays_again()?;
    }
    Ok(())
}

fn wander(world: &mut World, chance: &mut Chance) -> Checked {
    let ticks_per_choice = 1 + chance.below(6);
    while !world.is_done() {
        let now = world.control.borrow_mut().device().now();
        let late = now - world.watch.polled_at;
        let mut choices: Vec<_> = world.ready().collect();
        if late >= TICKS_PER_MS.into() {
            choices.push(Choice::Poll);
        }
        if late < LATEST_POLL_TICKS {
            choices.extend([Choice::Tick].repeat(ticks_per_choice));
        }
        if world.schedule.len() > MOST_CHOICES {
            return Err("a request is never done".to_owned());
        }
        let choice = choices[chance.below(choices.len())];
        if chance.below(60) == 0 {
            world.note_heard();
            world.control.borrow_mut().heard();
            let moved = world.control.borrow_mut().motion(motion());
            moved.expect("it is finite");
        }
        world.go_on(choice)?;
    }
    world.end()?;
    world.plays_again()
}

/// Explores pairs of the first requests, one per host.
fn explore_pairs(
    omission: Omission,
    waits: u32,
    take: impl Fn(usize, usize) -> bool,
) -> Result<usize, String> {
    let beginning = Beginning::new(true);
    let mut states = 0;
    for one in 0..PAIRED {
        for other in (0..PAIRED).filter(|&other| take(one, other)) {
            for plays in [false, true] {
                let scenario = Scenario {
                    beginning: &beginning,
                    lists: [&[REQUESTS[one]], &[REQUESTS[other]]],
                    plays,
                    omission,
                };
                states += scenario.explore(waits)?;
            }
        }
    }
    Ok(states)
}

#[test]
fn every_schedule_of_every_pair_of_requests_keeps_the_rules() {
    // The hosts are alike, so each pair once.
    let states = explore_pairs(Omission::None, 2 + budget::cases(1), |one, other| {
        one <= other
    });
    let states = states.unwrap_or_else(|problem| panic!("{problem}"));
    assert!(states > 5_000, "{states}");
}

#[test]
fn the_check_finds_a_play_that_comes_while_a_setting_is_stored() {
    let found = explore_pairs(Omission::LockOfConfiguration, 3, |one, other| one <= other);
    let found = found.expect_err("the lock is left out");
    assert!(found.contains("setting"), "{found}");
    assert!(
        found.contains("play") && found.contains("set a limit"),
        "{found}"
    );
}

#[test]
fn the_check_finds_a_device_that_stays_locked() {
    for omission in [Omission::EndOfActivation, Omission::EndOfConfiguration] {
        let found = explore_pairs(omission, 1, |one, other| one == other);
        assert!(found.is_err(), "{omission:?}: {found:?}");
    }
}

#[test]
fn random_schedules_of_many_requests_keep_the_rules() {
    let beginnings = [true, false].map(Beginning::new);
    for case in 0..u64::from(budget::cases(250)) {
        let mut chance = Chance::new(budget::seed(), case);
        let lists: [Vec<Request>; 2] = [(); 2].map(|()| {
            let length = 1 + chance.below(7);
            let draw = |_| {
                // Half of them of the first ones.
                let among = [PAIRED, REQUESTS.len()][chance.below(2)];
                REQUESTS[chance.below(among)]
            };
            (0..length).map(draw).collect()
        });
        let scenario = Scenario {
            beginning: &beginnings[chance.below(2)],
            lists: [&lists[0], &lists[1]],
            plays: chance.below(2) == 0,
            omission: Omission::None,
        };
        let wandered = scenario.wander(&mut chance);
        if let Err(problem) = wandered {
            let seed = budget::seed();
            panic!("with STYLUS_ATTACK_SEED={seed}, case {case}: {problem}");
        }
    }
}
