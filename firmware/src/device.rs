//! The hardware as `stylus_app::control` sees it.
#![expect(unsafe_code, reason = "the voices are exchanged while the tick plays nothing")]

use core::fmt::Write;

use cortex_m::peripheral::DWT;
use embassy_stm32::uid;
use embassy_time::Instant;
use heapless::String;
use model_format::link::{
    BoardName, CycleRange, CycleReport, DeviceInfo, LinkCounters, Marks, MotionSource, PROTOCOL_VERSION, PlayError,
    PlayRequest, RecordBlock, RecordCounters, RecordError, RecordStarted, RecordStopped, Response, SCHEMA_HASH,
    Selection, Settings, StartReport, TickCounters,
};
use model_format::scene::Biquad;
use model_format::{FORMAT_VERSION, PlayRate};
use stylus_app::SAMPLE_RATE_HZ;
use stylus_app::control::{Device, LoadFault, NotPrepared, ResetReport, TickReport, Waveform, plan_of};
use stylus_app::inputs::{Follower, InputConfig, Timed};
use stylus_app::levels::Sums;
use stylus_app::player::Piece;
use stylus_app::recorder::Recorder;
use stylus_app::safety::{self, Heat};
use stylus_app::status::Histogram;
use stylus_board::BOARD;
use stylus_boot::supply;
use stylus_kernel::scene::cost::BUDGET;
use stylus_kernel::scene::{Plan, Wave};

use crate::boot::clock::CORE_HZ;
use crate::boot::critical;
use crate::play::direction::{self, Next};
use crate::play::library_ram::LibraryRam;
use crate::play::{update, voice};
use crate::tick;
use crate::tick::output::amplifier;

/// All hardware except flash and links.
pub struct Hardware {
    library: LibraryRam,
    /// The recorder, which packs samples into blocks.
    recorder: Recorder<'static>,
    reset: ResetReport,
    start: StartReport,
    link_counters: fn() -> [LinkCounters; 2],
    guard_marks: fn() -> Marks,
    settings: Settings,
    kept_heat: Option<Heat>,
    /// Range of the durations that requests for cycles have taken out of the histogram, and the number of those ticks.
    taken: CycleRange,
    counted: u32,
    muted: bool,
    /// The first tick that has seen the present state of the mute.
    muted_since: u64,
}

impl Hardware {
    /// Hardware that plays and records nothing. There is only one, because the recorder's queue has one consuming end.
    pub fn new(
        recorder: Recorder<'static>,
        reset: ResetReport,
        start: StartReport,
        kept_heat: Option<Heat>,
        link_counters: fn() -> [LinkCounters; 2],
        guard_marks: fn() -> Marks,
    ) -> Self {
        // SAFETY: this runs once, because the caller gives up its only recorder.
        let library = unsafe { LibraryRam::new() };
        Self {
            library,
            recorder,
            reset,
            start,
            link_counters,
            guard_marks,
            settings: Settings::default(),
            kept_heat,
            taken: CycleRange::NONE,
            counted: 0,
            muted: true,
            muted_since: 0,
        }
    }
}

/// Name of the board.
pub const NAME: BoardName = BoardName::new(BOARD.name);

impl Device for Hardware {
    type Plan = Next;

    fn info(&self) -> DeviceInfo {
        let mut build = String::new();
        // Fits; otherwise the compiler would be left out.
        let (profile, compiler) = (env!("STYLUS_PROFILE"), env!("STYLUS_COMPILER"));
        let _ = write!(build, "{profile}, {compiler}");
        DeviceInfo {
            product: text("stylus"),
            serial: text(uid::uid_hex()),
            firmware_version: text(env!("CARGO_PKG_VERSION")),
            build,
            protocol_version: PROTOCOL_VERSION,
            library_format_version: FORMAT_VERSION,
            schema_hash: SCHEMA_HASH,
        }
    }

    fn now(&self) -> u64 {
        if self.start.safe_mode {
            // No tick runs, so embassy's clock is converted to ticks.
            return Instant::now().as_micros() * u64::from(SAMPLE_RATE_HZ) / 1_000_000;
        }
        tick::now()
    }

    fn tick_report(&self) -> TickReport {
        let Some(tick) = tick::snapshot() else {
            return TickReport {
                counters: TickCounters::default(),
                histogram: Histogram::new().report(CORE_HZ),
                saturations: 0,
                safety: safety::Counters::default(),
                thermal_load_permille: 0,
                thermal_gain_permille: 0,
                amplifier: false,
            };
        };
        TickReport {
            counters: tick.counters,
            histogram: tick.histogram.with_range(self.taken).report(CORE_HZ),
            saturations: voice::saturations(),
            safety: tick.safety.counters(),
            thermal_load_permille: tick.safety.thermal_load_permille(&tick.config),
            thermal_gain_permille: tick.safety.thermal_gain_permille(&tick.config),
            amplifier: amplifier::is_on(),
        }
    }

    fn marks(&self) -> Marks {
        Marks {
            longest_tick_delay_cycles: tick::snapshot().map_or(0, |tick| tick.longest_delay_cycles),
            longest_critical_section_cycles: critical::longest_cycles(),
            ..(self.guard_marks)()
        }
    }

    fn sensor_sums(&self) -> Sums {
        self.recorder.sums()
    }

    fn take_cycles(&mut self) -> CycleReport {
        let tick = tick::take_range(&mut self.counted);
        self.taken = self.taken.merged(tick);
        CycleReport {
            core_hz: CORE_HZ,
            tick,
            update: update::take_range(),
        }
    }

    fn link_counters(&self) -> [LinkCounters; 2] {
        (self.link_counters)()
    }

    fn reset_report(&self) -> ResetReport {
        self.reset.clone()
    }

    fn start_report(&self) -> StartReport {
        StartReport {
            supply_low: supply::is_low(),
            ..self.start
        }
    }

    fn is_at_rest(&self) -> bool {
        tick::is_at_rest(self.muted_since)
    }

    fn is_motion_stale(&self) -> bool {
        update::is_stale()
    }

    fn is_force_railed(&self) -> bool {
        update::is_railed()
    }

    fn set_mute(&mut self, muted: bool) {
        if muted != self.muted {
            self.muted_since = tick::set_muted(muted);
            self.muted = muted;
        }
    }

    fn plan(&self, selection: &Selection, response: Option<&Response>) -> Result<(Next, PlayRate), PlayError> {
        let library = self.library.library().ok_or(PlayError::NoLibrary)?;
        let (plan, rate) = plan_of(selection, &library, BUDGET, response)?;
        let follower = Follower::new(matches!(selection, Selection::Scene(_)));
        let next = Next {
            follower: follower.tracking(plan.has_lines()),
            plan,
        };
        Ok((next, rate))
    }

    fn waveform(&self) -> &'static Waveform {
        direction::waveform()
    }

    fn plan_wave(&self, wave: Wave<'static>, rate: PlayRate, sections: &[Biquad]) -> Next {
        let mut plan = Plan::of_wave(wave, rate.hz());
        plan.append(sections);
        Next {
            plan,
            follower: Follower::new(false),
        }
    }

    fn prepare(&mut self, plan: Next) {
        direction::prepare(plan);
    }

    fn start(&mut self, piece: &Piece, config: safety::Config) -> Result<(), NotPrepared> {
        let seed = match piece {
            Piece::Selected(request) => request.seed,
            Piece::Probe(_) => 0,
        };
        tick::stop();
        // SAFETY: the tick was stopped, and no task runs in the middle of a tick.
        unsafe {
            voice::clear();
            direction::start(seed)?;
        }
        // Before the first block, because the plan may have another rate than what was played before.
        tick::configure(config);
        tick::play();
        Ok(())
    }

    fn switch(&mut self, _request: &PlayRequest, plan: Next) {
        direction::switch(plan);
    }

    fn clear(&mut self) {
        tick::stop();
        // SAFETY: the tick was stopped.
        unsafe { direction::clear() };
    }

    fn set_motion_source(&mut self, source: MotionSource) {
        update::change(|update| update.source = source);
    }

    fn set_host_motion(&mut self, motion: Timed) {
        update::change(|update| update.host = motion);
    }

    fn set_settings(&mut self, settings: &Settings) {
        self.settings = *settings;
        let config = InputConfig::new(settings);
        update::change(|update| update.config = config);
        tick::configure(safety::Config::new(settings, 1.0));
    }

    fn kept_heat(&self) -> Option<Heat> {
        self.kept_heat
    }

    fn set_heat(&mut self, heat: Heat) {
        tick::set_heat(heat);
    }

    fn token_seed(&self) -> u64 {
        // A counter of cycles at the instant of a request, combined with the chip's unique number.
        let chip = uid::uid()
            .iter()
            .fold(0u64, |sum, byte| sum.rotate_left(11) ^ u64::from(*byte));
        chip ^ u64::from(DWT::cycle_count())
    }

    fn set_amplifier(&mut self, on: bool) {
        if on {
            amplifier::enable();
        } else {
            amplifier::disable();
        }
    }

    fn begin_load(&mut self) {
        self.clear();
        // SAFETY: only the director and the next plan hold textures beyond a call, and both were just cleared.
        unsafe { self.library.begin() };
    }

    fn load(&mut self, library: &[u8]) -> Result<bool, LoadFault> {
        self.library.load(library)
    }

    fn start_recording(&mut self) -> Result<RecordStarted, RecordError> {
        self.recorder.start()
    }

    fn stop_recording(&mut self) -> Result<RecordStopped, RecordError> {
        self.recorder.stop()
    }

    fn next_block(&mut self) -> Option<RecordBlock> {
        let now = self.now();
        self.recorder.next_block(now)
    }

    fn record_counters(&self) -> RecordCounters {
        self.recorder.counters()
    }
}

/// `text`, or an empty text if it does not fit.
fn text<const N: usize>(text: &str) -> String<N> {
    String::try_from(text).unwrap_or_default()
}
