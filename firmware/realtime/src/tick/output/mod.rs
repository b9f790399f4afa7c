//! The output: channel 1 of DAC1 on PA4, fed by DMA from a ring of codes.
//!
//! ```text
//! tick -> ring in SRAM 1 -> DMA1 stream 0 -> DHR12R1 -> DOR1 -> PA4 -> amplifier
//!           ^ DMA1 stream 1 writes mid-scale     ^ TIM7, 40 kHz: moves DHR to DOR and requests the next code
//! ```
//! TIM7 counts 25 µs. Its update is the trigger of the converter, so that neither software nor DMA shifts the instant
//! of an output. TIM7's update also triggers the eraser, which writes mid-scale over codes that have been put out.
//!
//! **The dead man's switch.** Both DMA streams are circular and need no instruction. When ticks end, because the core
//! is halted, locked up or in a loop, the output plays what the last tick wrote ahead: its codes, a hold, and a fade.
//! It stays at mid-scale from 1012.5 µs after that tick's trigger on ([`stylus_app::ring`]). Each tick checks that both
//! streams work, and panics otherwise.
//!
//! **Latency.** A tick's first code is on the pin 212.5 µs after the tick's trigger. DMA fetches the code from the ring
//! 162.5 µs after the trigger and writes it to the converter 25 µs later. The next update of TIM7 moves it to the pin.
//! TIM7's updates come 12.5 µs before and after TIM6's, so a handler that is some microseconds late still reads the
//! same position of the ring.
//!
//! **The self test.** [`by_hand`] lets it set codes while the amplifier is off; they take the same path.
//!
//! The ring must be neither in DTCM, which DMA does not reach (RM0433 section 2.1.6), nor cached.
//! `boot/startup.rs` turns the channel on, at mid-scale and with TIM7's trigger selected, before anything else runs.

pub mod amplifier;
mod ring;

use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::timer::vals::{Mms, Urs};
use embassy_stm32::pac::{DAC1, DMA1, DMAMUX1, RCC, TIM7};
use embassy_stm32::peripherals::{DMA1_CH0, DMA1_CH1};
use embassy_stm32::{Peri, peripherals, rcc};
use model_format::DacCode;
use stylus_app::ring::{ERASED_BEHIND, FADED_SLOTS, HELD_SLOTS, LENGTH, Slot, faded};
use stylus_app::safety::{OVERSAMPLING, PIN_RATE_HZ};
use stylus_board::pin;

use crate::boot::clock::TIMER_HZ;

/// Channel 1 of the converter, in the numbering of the registers.
const CHANNEL: usize = 0;

/// Streams of DMA1, and channels of DMAMUX1 (RM0433 section 17.3.2): the one to the converter, and the eraser.
const TO_CONVERTER: usize = 0;
const ERASER: usize = 1;

/// Requests of the converter's channel 1 and of TIM7's update (RM0433 table 124).
const REQUEST_DAC_1: u8 = 67;
const REQUEST_TIM7: u8 = 70;

/// Cycles of TIM7 per code.
const PERIOD_TIMER: u32 = TIMER_HZ / PIN_RATE_HZ;

const _: () = assert!(PERIOD_TIMER <= 1 << 16 && PERIOD_TIMER * PIN_RATE_HZ == TIMER_HZ);

/// Cycles of TIM7 in a period of the tick.
const PERIOD_TICK: u32 = PERIOD_TIMER * OVERSAMPLING as u32;

/// Time of the tick's trigger within a slot, cycles of TIM7: half a code's period after the slot's first code went to
/// the converter. [`Slot::ahead_of`] relies on it.
const TICK_IN_SLOT: u32 = PERIOD_TIMER + PERIOD_TIMER / 2;

/// Largest number of reads of a stream's enable bit until it must be clear, because a transfer under way ends within a
/// few bus cycles.
const LAST_TRANSFER_READS: usize = 100;

/// The peripherals and pins of the output.
pub struct Hardware {
    /// Clock of the codes.
    pub timer: Peri<'static, peripherals::TIM7>,
    /// Stream to the converter.
    pub to_converter: Peri<'static, DMA1_CH0>,
    /// Stream that overwrites codes with mid-scale.
    pub eraser: Peri<'static, DMA1_CH1>,
    /// The amplifier's enable.
    pub amplifier: Peri<'static, pin!(peripherals::amplifier)>,
}

/// The output, as the tick sees it.
pub struct Output {
    /// Codes that remained in the ring when the tick last looked.
    remaining: usize,
    /// Number of looks since the stream last moved.
    standing: u32,
    /// The last code written, steps from mid-scale.
    last: i32,
}

/// The place of the next codes, and the code before them.
#[derive(Clone, Copy)]
pub struct Next {
    slot: Slot,
    /// The code that is put out just before the next codes, steps from mid-scale.
    pub before: i32,
    /// True if `before` is not the last code written: that one was held and faded, or other codes were due in between.
    pub interrupted: bool,
}

impl Output {
    /// The output before its first code.
    pub const START: Self = Self {
        remaining: LENGTH,
        standing: 0,
        last: 0,
    };

    /// Finds the place of the next codes, and the code from which they have to continue.
    ///
    /// # Panics
    /// If a stream does not work, because then a core that stops would leave current in the coil.
    #[inline(always)]
    pub fn next_place(&mut self) -> Next {
        /// Eight ticks after a look the ring is at the same position again, so a single look proves nothing.
        const MOST_STANDING: u32 = 2;
        let remaining = remaining();
        self.standing = if remaining == self.remaining {
            self.standing + 1
        } else {
            0
        };
        self.remaining = remaining;
        let slot = Slot::ahead_of(remaining);
        assert!(self.standing < MOST_STANDING, "output: DMA takes no codes");
        assert!(
            ring::first(slot.erased()) == ring::MID_SCALE,
            "output: DMA does not erase"
        );
        let before = ring::last(slot.before()) as i32 - ring::MID_SCALE as i32;
        Next {
            slot,
            before,
            interrupted: before != self.last,
        }
    }

    /// Writes `codes`, and what is put out after them if no further tick comes. Returns true if the write came too late
    /// for the first code.
    #[inline(always)]
    pub fn write(&mut self, Next { slot, .. }: Next, codes: [DacCode; OVERSAMPLING]) -> bool {
        ring::fill(slot, codes.map(|code| u32::from(code.get())));
        let [.., last] = codes;
        let held = u32::from(last.get());
        for others in 0..HELD_SLOTS {
            ring::fill(slot.after(1 + others), [held; OVERSAMPLING]);
        }
        for others in 0..FADED_SLOTS {
            let faded = faded(last, others);
            ring::fill(slot.after(1 + HELD_SLOTS + others), faded);
        }
        self.last = held as i32 - ring::MID_SCALE as i32;
        // Ensures that all writes are in memory before the position is read.
        cortex_m::asm::dmb();
        slot.is_late(remaining())
    }
}

/// Codes that DMA has to put into the converter until the end of the ring.
#[inline(always)]
fn remaining() -> usize {
    usize::from(DMA1.st(TO_CONVERTER).ndtr().read().ndt())
}

/// Starts the codes, all of them mid-scale. The amplifier stays off until [`amplifier::enable`].
pub fn start(hardware: Hardware) {
    // The registers are used directly. These values are held so that no other driver can take the peripherals.
    let Hardware {
        timer: _timer,
        to_converter: _to_converter,
        eraser: _eraser,
        amplifier: _amplifier,
    } = hardware;
    mid_scale_now();
    start_clocks();
    ring::clear();
    set_up_streams();
    // While the converter is on, only these bits of its registers may change; TSEL may not (RM0433 section 26.4.7).
    DAC1.cr().modify(|w| w.set_ten(CHANNEL, true));
    DAC1.cr().modify(|w| w.set_dmaen(CHANNEL, true));
    start_timer();
}

/// Starts the clocks of the ring's memory (RM0433 section 8.7.42) and of the streams, and lets all clocks of the output
/// run while the core sleeps.
fn start_clocks() {
    RCC.ahb2enr().modify(|w| w.set_sram1en(true));
    RCC.ahb1enr().modify(|w| w.set_dma1en(true));
    RCC.ahb2lpenr().modify(|w| w.set_sram1lpen(true));
    RCC.ahb1lpenr().modify(|w| w.set_dma1lpen(true));
    RCC.apb1llpenr().modify(|w| {
        w.set_tim7lpen(true);
        w.set_dac12lpen(true);
    });
    let _ = RCC.apb1llpenr().read();
}

/// Lets the streams run; they wait for their first requests.
fn set_up_streams() {
    let [converter, eraser] = [TO_CONVERTER, ERASER].map(|stream| DMA1.st(stream));
    DMAMUX1.ccr(TO_CONVERTER).write(|w| w.set_dmareq_id(REQUEST_DAC_1));
    DMAMUX1.ccr(ERASER).write(|w| w.set_dmareq_id(REQUEST_TIM7));
    converter.par().write_value(DAC1.dhr12r(CHANNEL).as_ptr() as u32);
    converter.m0ar().write_value(ring::address());
    eraser.par().write_value(ring::eraser_address());
    eraser.m0ar().write_value(ring::address());
    for (stream, dir, priority) in [
        (converter, Dir::MEMORY_TO_PERIPHERAL, Pl::VERY_HIGH),
        (eraser, Dir::PERIPHERAL_TO_MEMORY, Pl::LOW),
    ] {
        stream.ndtr().write(|w| w.set_ndt(LENGTH as u16));
        // Direct mode, the reset value of FCR: one code waits in the stream, no more.
        stream.cr().write(|w| {
            w.set_dir(dir);
            w.set_circ(true);
            w.set_minc(true);
            // The converter's registers are accessed by words (RM0433 section 26.7).
            w.set_psize(Size::BITS32);
            w.set_msize(Size::BITS32);
            w.set_pl(priority);
        });
        stream.cr().modify(|w| w.set_en(true));
    }
}

/// Starts TIM7, and the eraser behind the codes that are put out.
fn start_timer() {
    rcc::enable_and_reset::<peripherals::TIM7>();
    TIM7.psc().write_value(0);
    TIM7.arr().write(|w| w.set_arr((PERIOD_TIMER - 1) as u16));
    TIM7.cr2().modify(|w| w.set_mms(Mms::UPDATE));
    TIM7.cr1().modify(|w| w.set_urs(Urs::COUNTER_ONLY));
    TIM7.cr1().modify(|w| w.set_cen(true));
    // The eraser's first request comes with the next code, so the eraser stays this far behind. An interrupt here adds
    // one or two codes to the distance, for which the ring is long enough.
    while remaining() > LENGTH - ERASED_BEHIND {}
    TIM7.dier().modify(|w| w.set_ude(true));
}

/// Returns the cycles of the timers from now to the next instant at which the tick's trigger must come. They are at
/// least a quarter of a code's period.
pub fn cycles_to_tick() -> u32 {
    loop {
        let count = u32::from(TIM7.cnt().read().cnt());
        // Long enough after an update that the stream has moved, and long enough before the next update.
        if (PERIOD_TIMER / 20..PERIOD_TIMER / 4).contains(&count) {
            let put = (LENGTH - remaining()) % OVERSAMPLING;
            let in_slot = put as u32 * PERIOD_TIMER + count;
            return (TICK_IN_SLOT + PERIOD_TICK - in_slot) % PERIOD_TICK;
        }
    }
}

/// Turns the amplifier off and sets the output to mid-scale, whatever state the program is in and whatever the timer
/// and DMA do later.
///
/// While the trigger is off, the holding register goes to the output one bus cycle after it is written, and when the
/// trigger is switched off, what was held goes there (RM0433 section 26.4.6).
#[inline(always)]
pub fn mid_scale_now() {
    amplifier::off_now();
    // A fault may come before the converter's clock is on.
    RCC.apb1lenr().modify(|w| w.set_dac12en(true));
    let _ = RCC.apb1lenr().read();
    DAC1.cr().modify(|w| w.set_dmaen(CHANNEL, false));
    // A transfer under way would write the holding register once more. If DMA has no clock, the stream reads as off.
    let stream = DMA1.st(TO_CONVERTER);
    stream.cr().modify(|w| w.set_en(false));
    for _ in 0..LAST_TRANSFER_READS {
        if !stream.cr().read().en() {
            break;
        }
    }
    let hold_mid_scale = || DAC1.dhr12r(CHANNEL).write(|w| w.set_dhr(DacCode::MID_SCALE.get()));
    // First, or the next code, which DMA has fetched, would be put out before its time.
    hold_mid_scale();
    DAC1.cr().modify(|w| w.set_ten(CHANNEL, false));
    // Once more, for a transfer that lasted longer than it was waited for.
    hold_mid_scale();
}

/// Returns true if `code` is at the converter's output.
#[inline(always)]
pub fn is_out(code: DacCode) -> bool {
    DAC1.dor(CHANNEL).read().dor() == code.get()
}

/// Returns true if the converter drives its pin with mid-scale now, and the trigger, both streams and the timer are on.
pub fn is_driven_at_mid_scale() -> bool {
    let control = DAC1.cr().read();
    control.en(CHANNEL)
        && control.ten(CHANNEL)
        && control.dmaen(CHANNEL)
        && DMA1.st(TO_CONVERTER).cr().read().en()
        && DMA1.st(ERASER).cr().read().en()
        && TIM7.cr1().read().cen()
        && DAC1.dor(CHANNEL).read().dor() == DacCode::MID_SCALE.get()
}

/// The output, set by the self test instead of the texture, with the amplifier disabled.
///
/// These codes take the path of all codes: the tick writes them into the ring, so they end when ticks end. The tick
/// uses them only while the amplifier is off. A new code begins in the middle of a tick's codes, when no handler runs
/// that would delay reading it back.
pub mod by_hand {
    use core::sync::atomic::{AtomicI32, Ordering};

    use model_format::DacCode;
    use stylus_app::safety::OVERSAMPLING;

    use crate::tick::output::{amplifier, is_out};

    /// Value of [`CODE`] while the output is not set by hand.
    const NOBODY: i32 = i32::MIN;

    /// The code, steps from mid-scale, or [`NOBODY`].
    static CODE: AtomicI32 = AtomicI32::new(NOBODY);

    /// The code of the previous tick, steps from mid-scale. Only the tick uses it.
    static BEFORE: AtomicI32 = AtomicI32::new(0);

    /// Returns true while the output is moved by hand.
    #[inline(always)]
    pub fn is_held() -> bool {
        CODE.load(Ordering::Relaxed) != NOBODY
    }

    /// The codes to put out in place of `codes`, which have passed the safety stages.
    #[inline(always)]
    pub fn instead_of(codes: [DacCode; OVERSAMPLING]) -> [DacCode; OVERSAMPLING] {
        let code = CODE.load(Ordering::Relaxed);
        if code == NOBODY || amplifier::is_on() {
            BEFORE.store(0, Ordering::Relaxed);
            return codes;
        }
        let before = BEFORE.load(Ordering::Relaxed);
        BEFORE.store(code, Ordering::Relaxed);
        let [before, code] = [before, code].map(DacCode::from_mid_scale);
        core::array::from_fn(|place| if place < OVERSAMPLING / 2 { before } else { code })
    }

    /// The right to set the output by hand. When it is dropped, the tick has the output again, and the amplifier is
    /// enabled if it was before.
    pub struct ByHand {
        was_wanted: bool,
    }

    impl ByHand {
        /// Disables the amplifier and takes the output, which is at rest.
        pub fn take() -> Self {
            let was_wanted = amplifier::is_wanted();
            amplifier::disable();
            CODE.store(0, Ordering::Relaxed);
            Self { was_wanted }
        }

        /// Sets the code, which is on the pin within three ticks.
        pub fn set(&self, code: DacCode) {
            let middle = i32::from(DacCode::MID_SCALE.get());
            CODE.store(i32::from(code.get()) - middle, Ordering::Relaxed);
        }

        /// The code that was set last; mid-scale at first.
        pub fn code(&self) -> DacCode {
            DacCode::from_mid_scale(CODE.load(Ordering::Relaxed))
        }

        /// Returns true if `code` is on the pin.
        #[inline(always)]
        pub fn is_out(&self, code: DacCode) -> bool {
            is_out(code)
        }
    }

    impl Drop for ByHand {
        fn drop(&mut self) {
            CODE.store(NOBODY, Ordering::Relaxed);
            if self.was_wanted {
                amplifier::enable();
            }
        }
    }
}
