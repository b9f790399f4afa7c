//! The hardware that [`Device`] requires, in memory.
//!
//! [`Hardware`] follows `firmware/src/device.rs`, with its tick and its update, statement by statement wherever a
//! request could observe a difference: a mute counts from the next tick on, the motion is judged once per block, new
//! settings replace the configuration of the safety stages, and a library's RAM is empty while it is exchanged.
//! [`Hardware`] is stricter than the real hardware in one respect: it panics where the application breaks the contract
//! of [`Device`], for example by exchanging a texture while the output sounds. The kernel computes the samples of a
//! probe and, if there is an [`Actuator`], all other samples too. Without an actuator the kernel is left out: while
//! something is played, the samples are those of a sine.

use std::sync::atomic::AtomicI16;

use model_format::limits::MAX_LIBRARY_BYTES;
use model_format::link::{
    BoardName, ClockSource, CycleRange, CycleReport, DeviceInfo, LinkCounters, Marks, MotionSource, PROTOCOL_VERSION,
    PlayError, PlayRequest, RecordBlock, RecordCounters, RecordError, RecordStarted, RecordStopped, ResetReason,
    Response, SCHEMA_HASH, Selection, Settings, SiliconRevision, StartReport, TickCounters,
};
use model_format::scene::Biquad;
use model_format::{DacCode, FORMAT_VERSION, Library, OutputSample, PlayRate};
use stylus_app::control::{Device, LoadFault, NotPrepared, ResetReport, TickReport, Waveform, plan_of};
use stylus_app::inputs::{Estimator, Follower, InputConfig, Sensors, Timed, choose};
use stylus_app::levels::Sums;
use stylus_app::player::Piece;
use stylus_app::recorder::{Recorder, SampleQueue, Tap};
use stylus_app::safety::{Config, Heat, OVERSAMPLING, State};
use stylus_app::status::Histogram;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::cost::BUDGET;
use stylus_kernel::scene::{Plan, Wave};

use crate::actuator::{Actuator, Performance, planned};
use crate::board::Board;
use crate::board::Hand;

/// Clock of the processor, Hz.
const CORE_HZ: u32 = 400_000_000;

/// Number of bytes that one step of a copy moves, as in the image.
const COPY_BYTES: usize = 8 * 1024;

/// The board.
pub const BOARD: BoardName = BoardName::new("NUCLEO-H743ZI2");

/// The report of a start without a fault, on silicon of revision V with the brown-out reset on.
const HEALTHY_START: StartReport = StartReport {
    board: BOARD,
    clock: ClockSource::External,
    revision: SiliconRevision(0x2003),
    brown_out_level: 3,
    supply_low: false,
    quick_faults: 0,
    safe_mode: false,
    hung_stage: None,
};

/// A plan of the fake hardware.
#[derive(Clone, Debug)]
pub enum Prepared {
    /// The selection that was found playable, its rate, and the response that equalises it.
    Selected(Selection, PlayRate, Option<Box<Response>>),
    /// A probe.
    Probe(Box<Plan<'static>>),
}

/// The hardware's state, which tests may inspect.
#[expect(clippy::struct_excessive_bools, reason = "each is a state of its own")]
pub struct Hardware {
    /// The library in RAM, empty if there is none.
    ram: Vec<u8>,
    /// True once all of a library was copied and found valid.
    is_loaded: bool,
    now: u64,
    muted: bool,
    /// The first tick to which the present mute applies.
    muted_since: u64,
    safety: State,
    /// Configuration of the safety stages.
    pub config: Config,
    /// The texture or scene that is played.
    pub playing: Option<PlayRequest>,
    waveform: &'static Waveform,
    /// DAC codes of the last tick.
    pub codes: [DacCode; OVERSAMPLING],
    /// The plan that was prepared and has not been started yet.
    pub prepared: Option<Prepared>,
    source: MotionSource,
    /// The host's last motion.
    pub host: Timed,
    /// True if the last update found the motion of the chosen source to be stale.
    is_stale: bool,
    /// True if the motion is stale because the force sensor is at a rail.
    is_railed: bool,
    sensors: Sensors,
    estimator: Estimator,
    inputs: InputConfig,
    /// The settings that were installed last.
    pub settings: Settings,
    tap: Tap<'static>,
    recorder: Recorder<'static>,
    histogram: Histogram,
    /// Range of the tick durations, and their number, that the requests for cycles have fetched so far.
    taken: CycleRange,
    counted: u32,
    /// Durations of the updates since the last request for cycles.
    updates: CycleRange,
    /// Counters of the only link, a serial one.
    pub link: LinkCounters,
    /// True while the amplifier is on.
    amplifier: bool,
    /// The board that the self test measures.
    pub board: Board,
    /// Number of codes other than mid-scale that the self test has put out.
    pub test_codes: usize,
    /// The encoder's counter.
    encoder: u16,
    /// Counts of the encoder since the start.
    pub place: i64,
    /// The hand that holds the stylus.
    pub hand: Hand,
    /// The plant at the output, if any.
    pub actuator: Option<Actuator>,
    /// The kernel, while something is played to a plant.
    performance: Option<Performance>,
    /// Number of next samples that are lost before they reach the recorder.
    pub lose_samples: u32,
    /// Number of next samples whose conversions do not all belong to their tick.
    pub tear_samples: u32,
    /// Changes what the device reports about itself, if set.
    pub disguise: Option<fn(&mut DeviceInfo)>,
    /// Number of ticks that count as missed.
    pub missed: u32,
    /// Number of ticks whose codes count as too late.
    pub late_outputs: u32,
    /// Extra cycles that are added to the duration of every tick.
    pub slower_by: u32,
    /// Instructions per tick that a scene may take.
    pub budget: u32,
    /// Number of the next steps of a load that fail, as if the library were damaged in RAM. A load ends with its first
    /// failure.
    pub bad_loads: u32,
    /// Heat of the coil that was kept across the reset before this start.
    pub kept_heat: Option<Heat>,
    /// Report of the start, with the present supply.
    pub start: StartReport,
    /// Number of exchanges of the library in RAM.
    pub exchanges: usize,
    /// Number of times that playing began from silence.
    pub starts: usize,
    /// Number of times that playing switched to something else without a pause.
    pub switches: usize,
}

impl Default for Hardware {
    fn default() -> Self {
        Self::new()
    }
}

impl Hardware {
    /// Creates hardware after power-on: it plays nothing, records nothing and has no library.
    pub fn new() -> Self {
        let settings = Settings::default();
        let config = Config::new(&settings, 1.0);
        // One queue per fake device is never freed, because both of its ends outlive every borrow that could own it.
        let queue: &'static mut SampleQueue = Box::leak(Box::new(SampleQueue::new()));
        let (producer, consumer) = queue.split();
        Self {
            ram: Vec::new(),
            now: 0,
            muted: true,
            muted_since: 0,
            safety: State::new(&config),
            config,
            playing: None,
            // Never freed, for the same reason as the queue.
            waveform: Box::leak(Box::new([const { AtomicI16::new(0) }; _])),
            codes: [DacCode::MID_SCALE; OVERSAMPLING],
            prepared: None,
            source: MotionSource::Sensors,
            host: Timed::NEVER,
            is_stale: true,
            is_railed: false,
            sensors: Sensors::new(),
            estimator: Estimator::new(),
            inputs: InputConfig::new(&settings),
            settings,
            tap: Tap::new(producer),
            recorder: Recorder::new(consumer),
            histogram: Histogram::new(),
            taken: CycleRange::NONE,
            counted: 0,
            updates: CycleRange::NONE,
            link: LinkCounters::default(),
            amplifier: false,
            board: Board::default(),
            test_codes: 0,
            encoder: 0,
            place: 0,
            hand: Hand::default(),
            actuator: None,
            performance: None,
            lose_samples: 0,
            tear_samples: 0,
            disguise: None,
            missed: 0,
            late_outputs: 0,
            slower_by: 0,
            budget: BUDGET,
            is_loaded: false,
            bad_loads: 0,
            kept_heat: None,
            start: HEALTHY_START,
            exchanges: 0,
            starts: 0,
            switches: 0,
        }
    }

    /// Runs one tick, in the order of the image's tick: read the sensors, update at the beginning of a block, put out,
    /// record.
    pub fn tick(&mut self) {
        self.now += 1;
        let mut sample = self.hand.sample(self.now, self.place);
        self.place += i64::from(sample.encoder_delta);
        if let Some(actuator) = &self.actuator {
            sample.acceleration = actuator.acceleration();
        }
        let whole = self.tear_samples == 0;
        self.tear_samples = self.tear_samples.saturating_sub(1);
        self.encoder = self.encoder.wrapping_add_signed(sample.encoder_delta);
        self.sensors.read(self.now, sample.encoder_delta, sample.force, whole);
        if self.now.is_multiple_of(UPDATE_INTERVAL_SAMPLES.into()) {
            self.sensors.end_block();
            let sensors = self.estimator.motion(&self.sensors, &self.inputs);
            let chosen = choose(self.source, sensors, self.host);
            self.is_stale = chosen.is_stale(self.now);
            if let Some(performance) = &mut self.performance {
                let rate = self.config.rate();
                performance.begin_block(chosen, &self.estimator, &self.inputs, self.now, rate);
            }
            // Any duration within the three ticks that an update has.
            let cycles = 60_000;
            self.updates = self.updates.merged(CycleRange {
                runs: 1,
                shortest: cycles,
                longest: cycles,
            });
            let by_rail = self.source == MotionSource::Sensors && self.sensors.is_railed();
            self.is_railed = self.is_stale && by_rail;
        }
        let mut samples = [self.next_sample(); 2];
        self.codes = match self.config.rate() {
            PlayRate::Hz5000 => (self.safety).process(&self.config, samples[0], self.muted),
            PlayRate::Hz10000 => {
                if let Some(performance) = &mut self.performance {
                    samples[1] = performance.next_sample();
                }
                self.safety.process_pair(&self.config, samples, self.muted)
            }
        };
        if let Some(actuator) = &mut self.actuator {
            actuator.put_out(self.codes, self.amplifier);
        }
        if self.lose_samples > 0 {
            self.lose_samples -= 1;
        } else {
            self.tap.put(self.now, sample, whole);
        }
        // Seven durations, so that they fill several bins of the histogram.
        self.histogram
            .count(20_000 + (self.now % 7) as u32 * 3_000 + self.slower_by);
    }

    /// Returns the next sample of the kernel, or of the sine that replaces it.
    fn next_sample(&mut self) -> OutputSample {
        if let Some(performance) = &mut self.performance {
            return performance.next_sample();
        }
        let phase = self.now as f32 * 0.3;
        let level = if self.playing.is_some() { 2e7 } else { 0.0 };
        OutputSample((phase.sin() * level) as i32)
    }

    /// The library in RAM; empty if there is none.
    pub fn library(&self) -> &[u8] {
        &self.ram
    }

    /// True if the tick is to mute the output.
    pub fn is_muted(&self) -> bool {
        self.muted
    }

    /// True while the output is not at rest.
    pub fn sounds(&self) -> bool {
        !self.safety.is_at_rest()
    }

    /// Heat of the coil, as it is kept for the next start.
    pub fn heat(&self) -> Heat {
        self.safety.heat()
    }

    /// The encoder's counter, which wraps.
    pub fn encoder_count(&self) -> u16 {
        self.encoder
    }
}

impl Device for Hardware {
    type Plan = Prepared;

    fn info(&self) -> DeviceInfo {
        let mut info = DeviceInfo {
            product: "stylus".try_into().expect("it is short"),
            serial: "0123456789ABCDEF01234567".try_into().expect("it is short"),
            firmware_version: env!("CARGO_PKG_VERSION").try_into().expect("it is short"),
            build: "fake".try_into().expect("it is short"),
            protocol_version: PROTOCOL_VERSION,
            library_format_version: FORMAT_VERSION,
            schema_hash: SCHEMA_HASH,
        };
        if let Some(disguise) = self.disguise {
            disguise(&mut info);
        }
        info
    }

    fn now(&self) -> u64 {
        self.now
    }

    fn tick_report(&self) -> TickReport {
        TickReport {
            counters: TickCounters {
                ticks: self.now,
                missed: self.missed,
                late_outputs: self.late_outputs,
                ..TickCounters::default()
            },
            histogram: self.histogram.with_range(self.taken).report(CORE_HZ),
            saturations: 0,
            safety: self.safety.counters(),
            thermal_load_permille: self.safety.thermal_load_permille(&self.config),
            thermal_gain_permille: self.safety.thermal_gain_permille(&self.config),
            amplifier: self.amplifier,
        }
    }

    fn marks(&self) -> Marks {
        Marks {
            stack_bytes: 48 << 10,
            stack_used_bytes: 6 << 10,
            longest_tick_delay_cycles: 400,
            longest_critical_section_cycles: 300,
            longest_watchdog_gap_us: 20_500,
        }
    }

    fn sensor_sums(&self) -> Sums {
        self.recorder.sums()
    }

    fn take_cycles(&mut self) -> CycleReport {
        let tick = self.histogram.take_range(&mut self.counted);
        self.taken = self.taken.merged(tick);
        CycleReport {
            core_hz: CORE_HZ,
            tick,
            update: std::mem::replace(&mut self.updates, CycleRange::NONE),
        }
    }

    fn link_counters(&self) -> [LinkCounters; 2] {
        [LinkCounters::default(), self.link]
    }

    fn reset_report(&self) -> ResetReport {
        ResetReport {
            reason: ResetReason::PowerOn,
            resets: 0,
            fault: None,
        }
    }

    fn start_report(&self) -> StartReport {
        self.start
    }

    fn is_at_rest(&self) -> bool {
        self.now >= self.muted_since && self.safety.is_at_rest()
    }

    fn is_motion_stale(&self) -> bool {
        self.is_stale
    }

    fn is_force_railed(&self) -> bool {
        self.is_railed
    }

    fn set_mute(&mut self, muted: bool) {
        if muted != self.muted {
            self.muted_since = self.now + 1;
            self.muted = muted;
        }
    }

    fn plan(&self, selection: &Selection, response: Option<&Response>) -> Result<(Prepared, PlayRate), PlayError> {
        if !self.is_loaded {
            return Err(PlayError::NoLibrary);
        }
        let library = Library::decode(&self.ram).map_err(|_| PlayError::NoLibrary)?;
        let (_, rate) = plan_of(selection, &library, self.budget, response)?;
        let response = response.copied().map(Box::new);
        Ok((Prepared::Selected(selection.clone(), rate, response), rate))
    }

    fn waveform(&self) -> &'static Waveform {
        self.waveform
    }

    fn plan_wave(&self, wave: Wave<'static>, rate: PlayRate, sections: &[Biquad]) -> Prepared {
        let mut plan = Plan::of_wave(wave, rate.hz());
        plan.append(sections);
        Prepared::Probe(Box::new(plan))
    }

    fn prepare(&mut self, plan: Prepared) {
        self.prepared = Some(plan);
    }

    fn start(&mut self, piece: &Piece, config: Config) -> Result<(), NotPrepared> {
        assert!(
            self.safety.is_at_rest(),
            "a texture is exchanged while the output sounds"
        );
        self.playing = None;
        self.performance = match (self.prepared.take().ok_or(NotPrepared)?, piece) {
            (Prepared::Selected(selection, rate, response), Piece::Selected(request)) => {
                assert_eq!(
                    (&selection, rate),
                    (&request.selection, config.rate()),
                    "another plan was prepared than is started"
                );
                self.playing = Some(request.clone());
                self.actuator.as_ref().map(|_| {
                    let plan = planned(&self.ram, &selection, response.as_deref());
                    Performance::new(plan, request.seed)
                })
            }
            (Prepared::Probe(plan), Piece::Probe(_)) => {
                assert_eq!(plan.sample_rate_hz(), config.rate().hz(), "another rate");
                Some(Performance::new((*plan, Follower::new(false)), 0))
            }
            (prepared, piece) => panic!("{prepared:?} was prepared, and {piece:?} is started"),
        };
        self.config = config;
        self.starts += 1;
        Ok(())
    }

    fn switch(&mut self, request: &PlayRequest, prepared: Prepared) {
        let Prepared::Selected(selection, rate, response) = prepared else {
            panic!("a probe is started from silence");
        };
        assert!(
            self.playing.is_some() && selection == request.selection && rate == self.config.rate(),
            "there is nothing to fade, or another plan to fade to"
        );
        if let Some(performance) = &mut self.performance {
            performance.switch(planned(&self.ram, &selection, response.as_deref()));
        }
        self.playing = Some(request.clone());
        self.switches += 1;
    }

    fn clear(&mut self) {
        assert!(
            self.safety.is_at_rest(),
            "a texture is exchanged while the output sounds"
        );
        self.playing = None;
        self.performance = None;
        self.prepared = None;
    }

    fn set_motion_source(&mut self, source: MotionSource) {
        self.source = source;
    }

    fn set_host_motion(&mut self, motion: Timed) {
        self.host = motion;
    }

    fn set_settings(&mut self, settings: &Settings) {
        self.settings = *settings;
        self.inputs = InputConfig::new(settings);
        self.config = Config::new(settings, 1.0);
    }

    fn kept_heat(&self) -> Option<Heat> {
        self.kept_heat
    }

    fn set_heat(&mut self, heat: Heat) {
        assert!(!self.amplifier, "the coil's heat is forgotten");
        self.safety.set_heat(heat);
    }

    fn token_seed(&self) -> u64 {
        self.now ^ 0x5eed_0123_4567_89ab
    }

    fn set_amplifier(&mut self, on: bool) {
        self.amplifier = on;
    }

    fn begin_load(&mut self) {
        assert!(
            self.safety.is_at_rest() && self.playing.is_none(),
            "the library is exchanged under a texture"
        );
        self.clear();
        self.exchanges += 1;
        self.is_loaded = false;
        self.ram.clear();
    }

    fn load(&mut self, library: &[u8]) -> Result<bool, LoadFault> {
        assert!(
            !self.is_loaded && self.safety.is_at_rest() && self.playing.is_none(),
            "a library is loaded that nobody has begun to, or under a texture"
        );
        let is_bad = self.bad_loads > 0;
        self.bad_loads = self.bad_loads.saturating_sub(1);
        if is_bad || library.len() > MAX_LIBRARY_BYTES {
            return Err(LoadFault);
        }
        let at = self.ram.len();
        let end = library.len().min(at + COPY_BYTES);
        self.ram.extend_from_slice(&library[at..end]);
        if at < end {
            return Ok(false);
        }
        Library::decode(&self.ram).map_err(|_| LoadFault)?;
        self.is_loaded = true;
        Ok(true)
    }

    fn start_recording(&mut self) -> Result<RecordStarted, RecordError> {
        self.recorder.start()
    }

    fn stop_recording(&mut self) -> Result<RecordStopped, RecordError> {
        self.recorder.stop()
    }

    fn next_block(&mut self) -> Option<RecordBlock> {
        self.recorder.next_block(self.now)
    }

    fn record_counters(&self) -> RecordCounters {
        self.recorder.counters()
    }
}
