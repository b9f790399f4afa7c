//! The tick, 5000 times per second: one sample, or two of a plan at 10 kHz.
//!
//! TIM6 counts 200 µs. Its update event is the trigger: it starts the converter's sequence and raises the interrupt.
//! The handler reads the conversions of the previous trigger, computes the samples, and writes their eight codes into
//! the ring of [`output`]. TIM7 and DMA put the codes out, the first one 212.5 µs after the trigger. So only timers set
//! the instants of sampling and output, and a signal on the pins at one trigger can be answered 412.5 µs later.
//!
//! The handler's code is in ITCM, and everything that it touches is in DTCM. The build fails if a call or an address in
//! the handler leads to flash. The handler takes no lock and logs nothing. The number of instructions depends on the
//! block that is played, never on the data.

#![expect(
    unsafe_code,
    reason = "a vector's name, its place in memory, and values that the tick owns"
)]

use core::hint::black_box;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::TIM6;
use embassy_stm32::pac::timer::vals::{Mms, Urs};
use embassy_stm32::{Peri, peripherals, rcc};
use model_format::link::{CycleRange, RecordSample, TickCounters};
use model_format::{OutputSample, PlayRate};
use stylus_app::inputs::{Encoder, Sensors};
use stylus_app::recorder::Tap;
use stylus_app::safety::{self, Wanted};
use stylus_app::status::Histogram;
use stylus_app::{SAMPLE_RATE_HZ, UPDATE_INTERVAL_TICKS, UPDATE_LEAD_TICKS};
use stylus_kernel::scene::Ringing;

use crate::boot::clock::{CORE_HZ, TIMER_HZ};
use crate::play::shared::OfHandler;
use crate::play::voice::{self, BlockIndex, Noted, Played};
use crate::tick::output::{Output, amplifier, by_hand};
use crate::tick::{alive, inputs, output};

/// Cycles of the processor per tick.
const PERIOD_CYCLES: u32 = CORE_HZ / SAMPLE_RATE_HZ;

/// Cycles of TIM6 per tick.
const PERIOD_TIMER: u32 = TIMER_HZ / SAMPLE_RATE_HZ;

const _: () = assert!(PERIOD_TIMER <= 1 << 16 && PERIOD_TIMER * SAMPLE_RATE_HZ == TIMER_HZ);

/// State of the tick, except for the voices.
pub struct Tick {
    safety: safety::State,
    config: safety::Config,
    output: Output,
    counters: TickCounters,
    histogram: Histogram,
    encoder: Encoder,
    sensors: Sensors,
    tap: Tap<'static>,
    /// Number of ticks since the present block began.
    phase: u32,
    /// The block that is played, if any.
    playing: Option<BlockIndex>,
    /// The ringing when that block began.
    ringing: Ringing,
    /// True if playing begins with the next block.
    begins: bool,
    /// True if the update was requested to decide the block after the one that is played.
    requested: bool,
    /// The processor's cycle at the last trigger.
    trigger: u32,
    /// Longest time from a trigger to the handler's entry, cycles of TIM6.
    longest_delay: u32,
}

static TICK: OfHandler<Option<Tick>> = OfHandler::new(None);

/// True while the output is to be mute.
static MUTED: AtomicBool = AtomicBool::new(true);

/// Counters and state of the tick, copied at one instant.
#[derive(Clone, Copy)]
pub struct Snapshot {
    /// Counters of the tick.
    pub counters: TickCounters,
    /// Histogram of the tick's duration.
    pub histogram: Histogram,
    /// State of the safety stages.
    pub safety: safety::State,
    /// Configuration of the safety stages.
    pub config: safety::Config,
    /// Longest time from a trigger to the handler's entry, cycles of the processor.
    pub longest_delay_cycles: u32,
}

/// Starts the output, and TIM6 with it; `tap` takes the samples to record. The cycle counter must run.
///
/// The phase between TIM6 and TIM7 stays as it is set here. It is within a microsecond of what [`output`] states,
/// because the store that starts TIM6 follows the load of TIM7's count by some instructions.
pub fn start(
    _timer: Peri<'static, peripherals::TIM6>,
    hardware: output::Hardware,
    tap: Tap<'static>,
    config: safety::Config,
) {
    rcc::enable_and_reset::<peripherals::TIM6>();
    TICK.with(|_, tick| {
        *tick = Some(Tick {
            safety: safety::State::new(&config),
            config,
            output: Output::START,
            counters: TickCounters::default(),
            histogram: Histogram::new(),
            encoder: Encoder::new(inputs::encoder_count()),
            sensors: Sensors::new(),
            tap,
            phase: 0,
            playing: None,
            ringing: Ringing::default(),
            begins: false,
            requested: false,
            trigger: DWT::cycle_count(),
            longest_delay: 0,
        });
    });
    output::start(hardware);
    TIM6.psc().write_value(0);
    TIM6.arr().write(|w| w.set_arr((PERIOD_TIMER - 1) as u16));
    // TRGO on an update event (RM0433 section 41.4.2), which only an overflow causes (section 41.4.1).
    TIM6.cr2().modify(|w| w.set_mms(Mms::UPDATE));
    TIM6.cr1().modify(|w| w.set_urs(Urs::COUNTER_ONLY));
    TIM6.dier().modify(|w| w.set_uie(true));
    critical_section::with(|_| {
        let count = PERIOD_TIMER - output::cycles_to_tick();
        TIM6.cnt().write(|w| w.set_cnt(count as u16));
        TIM6.cr1().modify(|w| w.set_cen(true));
    });
}

/// Number of ticks since the start.
pub fn now() -> u64 {
    TICK.with(|_, tick| tick.as_ref().map_or(0, |tick| tick.counters.ticks))
}

/// Sets the counts of ticks, blocks and encoder to shortly before the ends of their 32 bits, which for ticks is ten
/// days.
#[cfg(feature = "fault-injection")]
pub fn age() {
    const TICKS: u32 = u32::MAX - SAMPLE_RATE_HZ;
    TICK.with(|_, tick| {
        if let Some(tick) = tick {
            tick.counters.ticks = TICKS.into();
            tick.sensors.age();
        }
    });
    alive::set_ended(TICKS);
}

/// Counters and state of the tick; none before the start.
pub fn snapshot() -> Option<Snapshot> {
    TICK.with(|_, tick| {
        tick.as_ref().map(|tick| Snapshot {
            counters: tick.counters,
            histogram: tick.histogram,
            safety: tick.safety,
            config: tick.config,
            longest_delay_cycles: tick.longest_delay * (CORE_HZ / TIMER_HZ),
        })
    })
}

/// Returns the range of the ticks' durations since the last call, and begins a new range; see
/// [`Histogram::take_range`].
pub fn take_range(counted: &mut u32) -> CycleRange {
    TICK.with(|_, tick| {
        tick.as_mut()
            .map_or(CycleRange::NONE, |tick| tick.histogram.take_range(counted))
    })
}

/// Mutes or unmutes the output from the next tick on. Returns the earliest number that this tick can have.
pub fn set_muted(muted: bool) -> u64 {
    TICK.with(|_, tick| {
        MUTED.store(muted, Ordering::Relaxed);
        tick.as_ref().map_or(0, |tick| tick.counters.ticks + 1)
    })
}

/// Returns true if the output was at mid-scale, with the mute ramp down, at tick `since` or a later one, and before the
/// start.
pub fn is_at_rest(since: u64) -> bool {
    TICK.with(|_, tick| {
        tick.as_ref()
            .is_none_or(|tick| tick.counters.ticks >= since && tick.safety.is_at_rest())
    })
}

/// Sets the configuration of the safety stages from the next tick on.
pub fn configure(config: safety::Config) {
    TICK.with(|_, tick| {
        if let Some(tick) = tick {
            tick.config = config;
        }
    });
}

/// Heat of the coil; none before the start.
pub fn heat() -> Option<safety::Heat> {
    TICK.with(|_, tick| tick.as_ref().map(|tick| tick.safety.heat()))
}

/// Sets the heat of the coil, at the start.
pub fn set_heat(heat: safety::Heat) {
    TICK.with(|_, tick| {
        if let Some(tick) = tick {
            tick.safety.set_heat(heat);
        }
    });
}

/// Lets the tick play the voices of [`voice`] from the next block on.
pub fn play() {
    TICK.with(|_, tick| {
        if let Some(tick) = tick {
            tick.begins = true;
        }
    });
}

/// Stops playing at once. The output should be at rest before.
pub fn stop() {
    TICK.with(|_, tick| {
        if let Some(tick) = tick {
            tick.begins = false;
            tick.playing = None;
        }
    });
}

/// The tick's interrupt. **Deadline: 200 µs, until the next trigger.**
///
/// The time of a tick is bounded by the stages of the block, whose worst case was compared with a budget before the
/// plan was accepted. The safety stages, the queue and the counters take the same time at every tick. A tick begins
/// late by at most the longest critical section. If a tick ends after the next trigger, the next tick begins at once. A
/// trigger whose tick has not begun at the trigger after it is counted as missed. `status` shows the count and the
/// duration of ticks.
///
/// The codes of a sample are put out 212.5 µs after the trigger, however early they are computed.
///
/// Codes that are written more than 137.5 µs after the trigger go into the next slot. The output holds the last code
/// until then, and the codes continue from it within the slew limit.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.tick")]
extern "C" fn TIM6_DAC() {
    let delay = inputs::since_trigger();
    let begin = DWT::cycle_count();
    alive::begin();
    // Writing 0 clears a flag of a timer; writing 1 leaves it.
    TIM6.sr().write(|w| w.set_uif(false));
    // SAFETY: this is the handler that owns the value.
    let tick = unsafe { TICK.in_handler() };
    // `black_box` hides the address: if the compiler knew it, nearly every use would load it by two instructions.
    if let Some(tick) = black_box(tick) {
        tick.note_delay(delay);
        tick.run(begin);
        #[cfg(feature = "fault-injection")]
        crate::injection::in_tick();
        tick.histogram.count(DWT::cycle_count().wrapping_sub(begin));
    }
    alive::end();
}

impl Tick {
    /// Keeps the longest `delay`. The delay of the first tick is ignored, because the timer's first overflow, at an
    /// unknown time, pended that tick.
    #[inline(always)]
    fn note_delay(&mut self, delay: u32) {
        let delay = if self.counters.ticks == 0 { 0 } else { delay };
        self.longest_delay = self.longest_delay.max(delay);
    }

    #[inline(always)]
    fn run(&mut self, begin: u32) {
        let inputs = inputs::read();
        self.count_periods(begin, inputs.since_trigger);
        let now = self.counters.ticks;
        let delta = self.encoder.delta(inputs.encoder);
        self.sensors.read(now, delta, inputs.force, inputs.complete);
        // Before the first trigger there was no conversion to wait for.
        let late = !inputs.complete && now > 1;
        self.counters.late_conversions = self.counters.late_conversions.saturating_add(u32::from(late));
        if self.phase == 0 {
            self.begin_block();
        }
        if self.phase == UPDATE_INTERVAL_TICKS - UPDATE_LEAD_TICKS {
            self.request_update(now);
        }
        // A remainder would take more instructions.
        let phase = self.phase + 1;
        self.phase = if phase == UPDATE_INTERVAL_TICKS { 0 } else { phase };
        let muted = MUTED.load(Ordering::Relaxed) | amplifier::is_to_be_raised();
        let wanted = match self.config.rate() {
            PlayRate::Hz5000 => {
                let sample = match self.playing {
                    // SAFETY: this is the tick, and it plays this block.
                    Some(block) => unsafe { voice::next_sample(block) },
                    None => OutputSample::SILENCE,
                };
                self.safety.wanted(&self.config, sample, muted)
            }
            PlayRate::Hz10000 => self.wanted_of_pair(muted),
        };
        self.put_out(wanted);
        let sample = RecordSample {
            acceleration: inputs.acceleration,
            force: inputs.force,
            encoder_delta: delta,
        };
        self.tap.put(now, sample, inputs.complete);
    }

    /// Computes the signal of a tick at 10 kHz: two samples of the block. It is separate from the path at 5 kHz, so
    /// that neither path costs the other an instruction.
    #[inline(never)]
    #[unsafe(link_section = ".itcm.pair")]
    fn wanted_of_pair(&mut self, muted: bool) -> Wanted {
        let mut samples = [OutputSample::SILENCE; 2];
        if let Some(block) = self.playing {
            for sample in &mut samples {
                // SAFETY: this is called by the tick, and it plays this block.
                *sample = unsafe { voice::next_sample(block) };
            }
        }
        self.safety.wanted_of_pair(&self.config, samples, muted)
    }

    /// Writes `wanted` as codes, ahead of the codes that are being put out.
    #[inline(always)]
    fn put_out(&mut self, wanted: Wanted) {
        #[cfg(feature = "fault-injection")]
        crate::injection::before_output();
        let next = self.output.next_place();
        // Codes that are set by hand reach no coil, so the safety stages do not follow them.
        if !by_hand::is_held() {
            self.safety.continue_from(next.before);
        }
        let codes = self.safety.codes(&self.config, wanted);
        let codes = by_hand::instead_of(codes);
        let late = self.output.write(next, codes) | next.interrupted;
        self.counters.late_outputs = (self.counters.late_outputs).saturating_add(u32::from(late));
    }

    /// Counts the triggers since the last tick: one, or more if ticks were missed.
    ///
    /// The cycle of the trigger is the cycle at which the handler began minus the timer's count since the trigger, so
    /// the latency of the handler does not matter.
    #[inline(always)]
    fn count_periods(&mut self, begin: u32, since_trigger: u32) {
        let trigger = begin.wrapping_sub(since_trigger * (CORE_HZ / TIMER_HZ));
        let first = self.counters.ticks == 0;
        let periods = (trigger.wrapping_sub(self.trigger) + PERIOD_CYCLES / 2) / PERIOD_CYCLES;
        let periods = if first { 1 } else { periods.max(1) };
        self.trigger = trigger;
        self.counters.ticks += u64::from(periods);
        self.counters.missed = self.counters.missed.saturating_add(periods - 1);
        self.safety.miss(periods - 1);
    }

    /// Begins the block that was decided during the last one. If the update has not finished, the previous block
    /// continues.
    #[inline(always)]
    fn begin_block(&mut self) {
        if core::mem::take(&mut self.begins) {
            self.playing = Some(BlockIndex::FIRST);
            (self.ringing, self.requested) = (Ringing::default(), false);
        }
        if !voice::is_ready() {
            let late = u32::from(self.playing.is_some());
            self.counters.late_frames = self.counters.late_frames.saturating_add(late);
            return;
        }
        if core::mem::take(&mut self.requested) {
            self.playing = self.playing.map(BlockIndex::other);
        }
        if let Some(block) = self.playing {
            // SAFETY: this is the tick, which plays, and the update is ready.
            self.ringing = unsafe { voice::begin_block(block) };
        }
    }

    /// Requests the block after the one that is played, from the present motion, which is therefore heard
    /// [`UPDATE_LEAD_TICKS`] later. A block that was decided and has not begun yet is not decided again.
    #[inline(always)]
    fn request_update(&mut self, now: u64) {
        self.sensors.end_block();
        if self.requested || !voice::is_ready() {
            return;
        }
        self.requested = true;
        let ringing = self.ringing;
        let noted = Noted {
            sensors: self.sensors,
            tick: now,
            playing: self.playing.map(|block| Played { block, ringing }),
        };
        // SAFETY: this is the tick, and the update is ready.
        unsafe { voice::request(noted) };
    }
}
