//! A stylus in memory: the device's own application over simulated flash, its tick run in step with a clock.

use std::cell::RefCell;
use std::rc::Rc;

use model_format::limits::SLOT_BYTES;
use model_format::link::{
    ActivateError, DeviceInfo, LinkCounters, MotionSource, PROTOCOL_VERSION, PlayError,
    PlayRequest, RecordBlock, RecordCounters, RecordError, RecordSample, RecordStarted,
    RecordStopped, ResetReason, SCHEMA_HASH, Selection, Settings, SlotId, SlotInfo, TickCounters,
    UploadState,
};
use model_format::{AdcCode, FORMAT_VERSION, Library, OutputSample};
use stylus_app::control::{Control, Device, NotPrepared, ResetReport, TickReport, plan_of};
use stylus_app::inputs::{InputConfig, Sensors, Timed, choose};
use stylus_app::recorder::{Recorder, SampleQueue, Tap};
use stylus_app::safety::{Config, State};
use stylus_app::settings::SettingsStore;
use stylus_app::slots::SlotStore;
use stylus_app::status::Histogram;
use stylus_app::storage::{LoadFault, Stage, Storage};
use stylus_app::{SAMPLE_RATE_HZ, TICKS_PER_MS};
use stylus_kernel::scene::cost::BUDGET;

use super::flash::{Memory, SECTOR_BYTES, SimulatedFlash};

/// What the sensors see.
#[derive(Clone, Debug)]
pub struct Hand {
    pub speed_mm_s: f64,
    pub force_n: f64,
    /// Codes of the three axes, again and again.
    pub acceleration: Vec<[u16; 3]>,
}

impl Default for Hand {
    fn default() -> Self {
        Self {
            speed_mm_s: 0.0,
            force_n: 0.0,
            acceleration: vec![[32_768; 3]],
        }
    }
}

impl Hand {
    /// What the converters give at `tick`, with the default settings.
    pub fn sample(&self, tick: u64) -> RecordSample {
        let settings = Settings::default();
        let per_volt = f64::from(settings.get(model_format::link::Setting::ForcePerVolt));
        let path = f64::from(settings.get(model_format::link::Setting::PathPerCount));
        let force = self.force_n / per_volt / f64::from(AdcCode::STEP.0);
        let counts = |tick: u64| {
            let per_tick = self.speed_mm_s / path / f64::from(SAMPLE_RATE_HZ);
            (tick as f64 * per_tick).floor() as i64
        };
        let index = tick % self.acceleration.len() as u64;
        RecordSample {
            acceleration: self.acceleration[index as usize].map(AdcCode),
            force: AdcCode(force.round() as u16),
            encoder_delta: (counts(tick + 1) - counts(tick)) as i16,
        }
    }
}

/// The hardware's side.
pub struct Bench {
    ram: Vec<u8>,
    now: u64,
    muted: bool,
    safety: State,
    config: Config,
    playing: bool,
    source: MotionSource,
    host: Timed,
    sensors: Sensors,
    inputs: InputConfig,
    tap: Tap<'static>,
    recorder: Recorder<'static>,
    histogram: Histogram,
    pub hand: Hand,
    /// So many samples are lost before they reach the recorder.
    pub lose_samples: u32,
}

impl Bench {
    fn new() -> Self {
        let settings = Settings::default();
        let queue: &'static mut SampleQueue = Box::leak(Box::new(SampleQueue::new()));
        let (producer, consumer) = queue.split();
        Self {
            ram: Vec::new(),
            now: 0,
            muted: true,
            safety: State::new(),
            config: Config::new(&settings, 0.0),
            playing: false,
            source: MotionSource::Sensors,
            host: Timed::NEVER,
            sensors: Sensors::new(),
            inputs: InputConfig::new(&settings),
            tap: Tap::new(producer),
            recorder: Recorder::new(consumer),
            histogram: Histogram::new(),
            hand: Hand::default(),
            lose_samples: 0,
        }
    }

    /// A tick; while something is played it is a sine.
    fn tick(&mut self) {
        let sample = self.hand.sample(self.now);
        if self.lose_samples > 0 {
            self.lose_samples -= 1;
        } else {
            self.tap.put(self.now, sample);
        }
        self.sensors
            .read(self.now, sample.encoder_delta, sample.force, true);
        if self.now.is_multiple_of(10) {
            self.sensors.end_block();
        }
        let phase = self.now as f32 * 0.3;
        let output = if self.playing { phase.sin() * 2e7 } else { 0.0 };
        self.safety
            .process(&self.config, OutputSample(output as i32), self.muted);
        self.histogram.count(20_000 + (self.now % 7) as u32 * 3_000);
        self.now += 1;
    }
}

impl Device for Bench {
    type Plan = ();

    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            product: "stylus".try_into().expect("short"),
            serial: "0123456789ABCDEF01234567".try_into().expect("short"),
            firmware_version: env!("CARGO_PKG_VERSION").try_into().expect("short"),
            build: "bench".try_into().expect("short"),
            protocol_version: PROTOCOL_VERSION,
            library_format_version: FORMAT_VERSION,
            schema_hash: SCHEMA_HASH,
        }
    }

    fn now(&self) -> u64 {
        self.now
    }

    fn tick_report(&self) -> TickReport {
        TickReport {
            counters: TickCounters {
                ticks: self.now,
                ..TickCounters::default()
            },
            histogram: self.histogram.report(400_000_000),
            saturations: 0,
            safety: self.safety.counters(),
            thermal_load_permille: self.safety.thermal_load_permille(),
            thermal_gain_permille: self.safety.thermal_gain_permille(),
        }
    }

    fn link_counters(&self) -> [LinkCounters; 2] {
        [LinkCounters::default(); 2]
    }

    fn reset_report(&self) -> ResetReport {
        ResetReport {
            reason: ResetReason::PowerOn,
            resets: 0,
            fault: None,
        }
    }

    fn is_at_rest(&self) -> bool {
        self.safety.is_at_rest()
    }

    fn is_motion_stale(&self) -> bool {
        let sensors = self.sensors.motion(&self.inputs);
        choose(self.source, sensors, self.host).is_stale(self.now)
    }

    fn set_mute(&mut self, muted: bool) {
        self.muted = muted;
    }

    fn plan(&self, selection: &Selection) -> Result<(), PlayError> {
        let library = Library::decode(&self.ram).map_err(|_| PlayError::NoLibrary)?;
        plan_of(selection, &library, BUDGET).map(|_| ())
    }

    fn prepare(&mut self, (): ()) {}

    fn start(&mut self, _request: &PlayRequest, config: Config) -> Result<(), NotPrepared> {
        self.playing = true;
        self.config = config;
        Ok(())
    }

    fn switch(&mut self, _request: &PlayRequest, (): ()) {}

    fn clear(&mut self) {
        self.playing = false;
    }

    fn set_motion_source(&mut self, source: MotionSource) {
        self.source = source;
    }

    fn set_host_motion(&mut self, motion: Timed) {
        self.host = motion;
    }

    fn set_settings(&mut self, settings: &Settings) {
        self.inputs = InputConfig::new(settings);
    }

    fn start_recording(&mut self) -> Result<RecordStarted, RecordError> {
        self.recorder.start()
    }

    fn stop_recording(&mut self) -> Result<RecordStopped, RecordError> {
        self.recorder.stop()
    }

    fn record_counters(&self) -> RecordCounters {
        self.recorder.counters()
    }
}

pub type Shared = Rc<RefCell<Control<Bench>>>;

/// What storage needs of the rest.
pub struct Hall(Shared);

impl Stage for Hall {
    fn begin_activation(&mut self) -> Result<(), ActivateError> {
        self.0.borrow_mut().begin_activation()
    }

    fn may_exchange(&self) -> bool {
        self.0.borrow().may_exchange()
    }

    fn load(&mut self, library: &[u8]) -> Result<(), LoadFault> {
        self.0.borrow_mut().device().ram = library.to_vec();
        Ok(())
    }

    fn end_activation(&mut self, active: Option<(SlotId, SlotInfo)>) {
        self.0.borrow_mut().end_activation(active);
    }

    fn is_idle(&self) -> bool {
        self.0.borrow().is_idle()
    }

    fn set_settings(&mut self, settings: Settings, faulty: bool) {
        self.0.borrow_mut().set_settings(settings, faulty);
    }

    fn set_upload(&mut self, upload: UploadState) {
        self.0.borrow_mut().set_upload(upload);
    }

    async fn pause(&mut self) {
        millisecond(&self.0);
    }
}

fn millisecond(control: &Shared) {
    let mut control = control.borrow_mut();
    for _ in 0..TICKS_PER_MS {
        control.device().tick();
    }
    control.poll();
}

/// The application's three parts.
pub struct Stylus {
    pub control: Shared,
    pub hall: Hall,
    pub storage: Storage<SimulatedFlash<'static>, SimulatedFlash<'static>>,
}

impl Stylus {
    /// Boots on blank flash.
    pub async fn boot() -> Self {
        let flash = SimulatedFlash::new(Memory::blank(2 * SLOT_BYTES));
        let slots = SlotStore::open(flash).await;
        let range = 0..2 * SECTOR_BYTES as u32;
        let flash = SimulatedFlash::new(Memory::blank(2 * SECTOR_BYTES));
        let settings = SettingsStore::open(flash, range).await;
        let control = Control::new(Bench::new(), settings.settings(), settings.is_faulty());
        let control = Rc::new(RefCell::new(control));
        let mut hall = Hall(control.clone());
        let mut storage = Storage::new(slots, settings);
        storage.activate_newest(&mut hall).await;
        Self {
            control,
            hall,
            storage,
        }
    }

    /// Runs the tick and the millisecond's work up to `tick`, and gives the blocks that were recorded meanwhile.
    pub fn run_until(&mut self, tick: u64) -> Vec<RecordBlock> {
        let mut blocks = Vec::new();
        while self.control.borrow_mut().device().now < tick {
            millisecond(&self.control);
            let mut control = self.control.borrow_mut();
            let bench = control.device();
            let now = bench.now;
            blocks.extend(std::iter::from_fn(|| bench.recorder.next_block(now)));
        }
        blocks
    }
}
