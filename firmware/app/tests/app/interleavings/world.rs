//! A device with two hosts, whose tasks continue one step at a time, and what must hold at each step.

use std::pin::Pin;
use std::task::{Context, Waker};

use embassy_futures::block_on;
use fake_stylus::device::{COIL, MOTION, SharedControl, SteppedStylus, change};
use fake_stylus::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::put;
use fake_stylus::requests::Requests;
use model_format::PlayRate;
use model_format::limits::SLOT_BYTES;
use model_format::link::{Activity, LinkId, ProposalToken, Setting, Settings, SlotId};
use postcard_rpc::header::{VarHeader, VarSeq};
use stylus_app::TICKS_PER_MS;
use stylus_app::control::Device;
use stylus_app::safety::Config;
use stylus_app::settings::SettingsStore;
use stylus_boot::map::RECORDS;

use super::Mistake;
use super::list::{LIBRARIES, REQUESTS, Request, applied, changed, rate_of};
use crate::update::{RUNNING, recorded, trial, updates};

/// Time within which the output is silent after a mute begins, ticks: 100 ms, and the lateness of the poll.
const SILENT_WITHIN_TICKS: u64 = (100 * TICKS_PER_MS) as u64 + LATEST_POLL_TICKS;

/// Largest number of ticks between two polls under random schedules.
pub const LATEST_POLL_TICKS: u64 = 2 * TICKS_PER_MS as u64;

/// Time after which nothing may be under way any more, ms: an activation waits 500 ms for rest.
const SETTLED_AFTER_MS: u32 = 1_500;

/// Settings in flash: the coil's, and the shortest possible ramps if `brief`.
fn stored_settings(brief: bool) -> Memory {
    let mut flash = SimulatedFlash::new(Memory::blank(2 * SECTOR_BYTES));
    let range = 0..2 * SECTOR_BYTES as u32;
    let mut store = block_on(SettingsStore::open(&mut flash, range));
    let ramps = [Setting::MuteRamp, Setting::SoftStart].map(|ramp| change(ramp, ramp.spec().lowest));
    for change in COIL.into_iter().chain(ramps.into_iter().filter(|_| brief)) {
        block_on(store.set(change)).expect("it is in range");
    }
    flash.memory
}

/// Flashes at the beginning: a library in each slot, A being the newer one; the settings; and the record of a trial.
pub struct Beginning {
    slots: Memory,
    settings: Memory,
    /// None without a bootloader.
    records: Option<Memory>,
}

impl Beginning {
    pub fn new(brief: bool, on_trial: bool) -> Self {
        let mut slots = Memory::blank(2 * SLOT_BYTES);
        put(&mut slots, SlotId::A, &LIBRARIES[0], 2);
        put(&mut slots, SlotId::B, &LIBRARIES[1], 1);
        Self {
            slots,
            settings: stored_settings(brief),
            records: on_trial.then(|| recorded(Memory::blank(RECORDS.end as usize), trial())),
        }
    }
}

/// The task that continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The link of this host serves its next frame.
    Host(usize),
    /// The storage continues to its next await.
    Storage,
    /// A millisecond: its ticks, then the poll.
    Millisecond,
    /// One tick.
    Tick,
    /// The poll.
    Poll,
}

pub type Checked = Result<(), String>;

/// Observations that must hold at every point.
pub struct Watch {
    settings: Settings,
    rate: PlayRate,
    muted_since: Option<u64>,
    pub polled_at: u64,
}

impl Watch {
    fn new(control: &SharedControl) -> Self {
        let mut control = control.borrow_mut();
        Self {
            settings: control.settings(),
            rate: control.device().config.rate(),
            muted_since: None,
            polled_at: control.device().now(),
        }
    }

    fn look(&mut self, control: &SharedControl) -> Checked {
        let mut control = control.borrow_mut();
        let status = control.status();
        let (mute, state, active) = (status.output.mute, status.settings, status.active);
        let settings = control.settings();
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
        if let Some(playing) = &hardware.playing {
            let rate = rate_of(&playing.selection);
            if hardware.config != Config::at_rate(&settings, playing.gain, rate) {
                return Err("what sounds has another gain or rate than it was played with".into());
            }
        }
        let rate = hardware.config.rate();
        if std::mem::replace(&mut self.rate, rate) != rate && hardware.sounds() {
            return Err("the rate changed while it sounded".to_owned());
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

/// The links of the two hosts.
const LINKS: [LinkId; 2] = [LinkId::Usb, LinkId::Serial];

/// A host, with its frames that have not been sent yet.
struct Host {
    requests: Vec<Request>,
    sent: usize,
    /// True between the two frames of a change of settings.
    has_proposed: bool,
}

/// A device, its tasks, and two hosts.
pub struct World {
    pub control: SharedControl,
    mistake: Mistake,
    requests: Requests,
    storage: Pin<Box<dyn Future<Output = ()>>>,
    hosts: [Host; 2],
    /// Number of answers per sequence number.
    answers: Vec<u32>,
    expected: Vec<bool>,
    pub watch: Watch,
    /// The tick at which each host last renewed its lease, if it has one.
    renewed_at: [u64; 2],
    pub schedule: Vec<Choice>,
}

impl World {
    pub fn new(beginning: &Beginning, lists: [&[Request]; 2], plays: bool, mistake: Mistake) -> Self {
        let stylus = SteppedStylus::boot_as(
            SimulatedFlash::new(beginning.slots.clone()),
            SimulatedFlash::new(beginning.settings.clone()),
            Hardware::new(),
        );
        let SteppedStylus { control, mut storage } = stylus;
        if let Some(records) = &beginning.records {
            storage.set_updates(updates(records.clone(), RUNNING));
        }
        let requests = Requests::new(control.clone());
        let served = requests.clone();
        let mut world = Self {
            watch: Watch::new(&control),
            control,
            mistake,
            requests,
            storage: Box::pin(async move { served.serve_storage(&mut storage).await }),
            hosts: lists.map(|list| Host {
                requests: list.to_vec(),
                sent: 0,
                has_proposed: false,
            }),
            answers: Vec::new(),
            expected: Vec::new(),
            renewed_at: [0; 2],
            schedule: Vec::new(),
        };
        if plays {
            world.serve(0, &REQUESTS[0]);
            for _ in 0..8 {
                world.millisecond().expect("it plays alone");
            }
        }
        world
    }

    /// Serves a request of a host.
    fn serve(&mut self, host: usize, request: &Request) {
        let number = self.expected.len() as u32;
        if request.renews {
            self.note_renewed(host);
        }
        self.expected.push(request.answered);
        self.answers.push(0);
        let frame = if self.hosts[host].has_proposed {
            let control = self.control.borrow();
            let proposal = control.status().proposal;
            let token = proposal.map_or(ProposalToken(0), |it| it.token);
            applied("apply", token).frame(number)
        } else {
            request.frame(number)
        };
        if let Some(answer) = self.requests.serve(LINKS[host], &frame, false) {
            self.count(&answer);
        }
    }

    /// Number of the host that plays, or else of the host whose lease was renewed last, because what it played may
    /// still fade.
    fn holder(&self) -> usize {
        let holder = self.control.borrow().status().lease.holder;
        LINKS
            .iter()
            .position(|&link| Some(link) == holder)
            .unwrap_or(usize::from(self.renewed_at[1] > self.renewed_at[0]))
    }

    /// The host that plays moves the tool.
    pub fn moves(&mut self) {
        let holder = self.holder();
        self.note_renewed(holder);
        self.control
            .borrow_mut()
            .motion(LINKS[holder], MOTION)
            .expect("it is finite, and this host plays");
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

    pub fn is_done(&self) -> bool {
        self.hosts.iter().all(|host| host.sent == host.requests.len()) && !self.requests.is_storage_busy()
    }

    /// The tasks that can continue without waiting for time to pass.
    pub fn ready(&self) -> impl Iterator<Item = Choice> + use<> {
        let hosts = [0, 1].map(|index| {
            let host = &self.hosts[index];
            (host.sent < host.requests.len()).then_some(Choice::Host(index))
        });
        let storage =
            (self.requests.is_storage_busy() && !self.control.is_storage_waiting()).then_some(Choice::Storage);
        hosts.into_iter().chain([storage]).flatten()
    }

    pub fn go_on(&mut self, choice: Choice) -> Checked {
        self.schedule.push(choice);
        match choice {
            Choice::Host(index) => {
                let host = &self.hosts[index];
                let request = host.requests[host.sent].clone();
                self.serve(index, &request);
                let host = &mut self.hosts[index];
                host.has_proposed = request.then_applies && !host.has_proposed;
                host.sent += usize::from(!host.has_proposed);
            }
            Choice::Storage => self.storage_goes_on(),
            Choice::Millisecond => self.millisecond()?,
            Choice::Tick => self.control.borrow_mut().device().tick(),
            Choice::Poll => {
                let mut control = self.control.borrow_mut();
                control.poll();
                self.watch.polled_at = control.device().now();
            }
        }
        self.watch.look(&self.control)?;
        let renewed_at = self.renewed_at[self.holder()];
        let mut control = self.control.borrow_mut();
        let now = control.device().now();
        if now - renewed_at > SILENT_WITHIN_TICKS && control.device().sounds() {
            return Err("it sounds although the host that plays was not heard".to_owned());
        }
        Ok(())
    }

    fn storage_goes_on(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        let _ = self.storage.as_mut().poll(&mut context);
        (self.mistake)(&mut self.control.borrow_mut());
        for (_, answer) in self.requests.take_answers() {
            self.count(&answer);
        }
    }

    /// A millisecond in which the host that plays sends a motion.
    fn millisecond(&mut self) -> Checked {
        self.moves();
        self.control.millisecond();
        self.watch.polled_at = self.control.borrow_mut().device().now();
        self.watch.look(&self.control)
    }

    fn note_renewed(&mut self, host: usize) {
        self.renewed_at[host] = self.control.borrow_mut().device().now();
    }

    /// Runs to the end of all requests, and checks it.
    pub fn end(&mut self) -> Checked {
        let mut waited_ms = 0;
        while !self.is_done() {
            if waited_ms > SETTLED_AFTER_MS {
                return Err("a request is never done".to_owned());
            }
            // A request for flash continues many times per millisecond.
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
    pub fn plays_again(&mut self) -> Checked {
        let named = |name| {
            REQUESTS
                .iter()
                .find(|request| request.name == name)
                .expect("it is in the list")
                .clone()
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
            return Err(format!("after a stop it is {activity:?}, sounding: {sounds}"));
        }
        let settings = self.control.borrow().status().settings;
        if settings.check_playable().is_err() {
            self.do_alone(changed("the coil's settings", &COIL))?;
        }
        for activation in ["activate A", "activate B"] {
            if self.control.borrow().status().active.is_none() {
                self.do_alone(named(activation))?;
            }
        }
        let starts = self.control.borrow_mut().device().starts;
        self.do_alone(named("play"))?;
        for _ in 0..60 {
            self.go_on(Choice::Millisecond)?;
        }
        let mut control = self.control.borrow_mut();
        let mute = control.status().output.mute;
        let hardware = control.device();
        if hardware.starts == starts || !hardware.sounds() || !mute.is_empty() {
            return Err(format!("it does not play again: {mute:?}"));
        }
        Ok(())
    }
}
