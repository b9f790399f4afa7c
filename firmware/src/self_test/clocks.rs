//! Measures clocks against each other: LSI by TIM16, and ticks and USB frames by the core's cycle counter.

use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::timer::vals::CcmrInputCcs;
use embassy_stm32::pac::{TIM16, USB_OTG_FS};
use embassy_stm32::{peripherals, rcc};
use embassy_time::{Duration, Instant};
use model_format::link::{ClockCount, ClockValues};

use crate::boot::clock::{CORE_HZ, TIMER_HZ};
use crate::tick;

/// `TIM16_TISEL`: LSI instead of the pin (RM0433, TIM16 timer input selection register).
const LOW_SPEED_INPUT: u8 = 1;

/// Periods per capture: one edge in eight, about 250 µs apart.
const PERIODS_PER_CAPTURE: u32 = 8;

/// `IC1PSC` of 11: a capture every eight edges.
const CAPTURE_PRESCALER: u8 = 3;

/// Captures to count, about a quarter of a second.
const CAPTURES: u32 = 1_000;

/// Time within which these captures come, including those that are overwritten.
const LOW_SPEED_LIMIT: Duration = Duration::from_millis(600);

/// Ticks to count: one second.
const TICKS: u32 = 5_000;

/// Time within which these ticks come.
const TICKS_LIMIT: Duration = Duration::from_secs(2);

/// Longest busy wait for the next tick, cycles: two periods.
const EDGE_CYCLES: u32 = CORE_HZ / 2_500;

/// Counts all clocks.
pub async fn count() -> ClockValues {
    let low_speed = low_speed().await;
    let begin = tick_edge();
    let usb_frames = count_frames().await;
    // The cycle counter wraps after ten seconds, so the second of the frames does not matter.
    let started = Instant::now();
    let ticks = loop {
        let (tick, cycle) = tick_edge();
        let periods = tick.wrapping_sub(begin.0) as u32;
        // In safe mode there are no ticks.
        if periods >= TICKS || since(started) > TICKS_LIMIT {
            break ClockCount {
                periods,
                cycles: cycle.wrapping_sub(begin.1).into(),
            };
        }
        // Each search for an edge is a busy wait, so the tasks run in between.
        for _ in 0..16 {
            yield_now().await;
        }
    };
    ClockValues {
        core_hz: CORE_HZ,
        timer_hz: TIMER_HZ,
        low_speed,
        usb_frames,
        ticks,
    }
}

/// Waits for the next tick; returns the number of that tick and the core's cycle.
fn tick_edge() -> (u64, u32) {
    let before = tick::now();
    let begin = DWT::cycle_count();
    loop {
        let now = tick::now();
        let cycle = DWT::cycle_count();
        if now != before || cycle.wrapping_sub(begin) > EDGE_CYCLES {
            return (now, cycle);
        }
    }
}

/// Measures periods of LSI in cycles of TIM16; none if no capture came. TIM16 is off afterwards.
async fn low_speed() -> Option<ClockCount> {
    rcc::enable_and_reset::<peripherals::TIM16>();
    TIM16.arr().write(|w| w.set_arr(u16::MAX));
    TIM16.tisel().write(|w| w.set_tisel(0, LOW_SPEED_INPUT));
    TIM16.ccmr_input(0).modify(|w| {
        // The name is meant for channel 4; for channel 1 the code means TI1.
        w.set_ccs(0, CcmrInputCcs::TI4);
        w.set_icpsc(0, CAPTURE_PRESCALER);
    });
    TIM16.ccer().modify(|w| w.set_cce(0, true));
    TIM16.cr1().modify(|w| w.set_cen(true));
    let counted = captures().await;
    rcc::disable::<peripherals::TIM16>();
    (counted.periods > 0).then_some(counted)
}

/// Sums the times between successive captures. A time in which a capture was overwritten is left out.
async fn captures() -> ClockCount {
    let begin = Instant::now();
    let mut counted = ClockCount { periods: 0, cycles: 0 };
    let mut before: Option<u16> = None;
    while counted.periods < CAPTURES * PERIODS_PER_CAPTURE && since(begin) < LOW_SPEED_LIMIT {
        let status = TIM16.sr().read();
        if !status.ccif(0) {
            yield_now().await;
            continue;
        }
        // Reading the capture clears its flag. Writing 0 clears the flag of an overwritten capture (RM0433, TIM16_SR).
        let capture = TIM16.ccr(0).read().ccr();
        let overwritten = TIM16.sr().read().ccof(0);
        TIM16.sr().modify(|w| w.set_ccof(0, false));
        if let Some(before) = before
            && !overwritten
        {
            counted.periods += PERIODS_PER_CAPTURE;
            counted.cycles += u64::from(capture.wrapping_sub(before));
        }
        before = (!overwritten).then_some(capture);
    }
    counted
}

/// Frames to count: one second.
const FRAMES: u32 = 1_000;

/// Frame numbers have eleven bits at full speed (RM0433, OTG_DSTS).
const FRAME_MASK: u16 = 0x7ff;

/// Longest time between the two looks that enclose an edge: 50 µs, which is 50 ppm of the second.
const FRAME_EDGE_CYCLES: u32 = CORE_HZ / 20_000;

/// Time within which an edge is found.
const FRAME_EDGE_LIMIT: Duration = Duration::from_millis(300);

fn frame_number() -> u16 {
    USB_OTG_FS.dsts().read().fnsof() & FRAME_MASK
}

/// Waits for the beginning of a frame, located to within [`FRAME_EDGE_CYCLES`]; returns its number and the core's
/// cycle, and none if no such beginning is found in [`FRAME_EDGE_LIMIT`].
async fn frame_edge() -> Option<(u16, u32)> {
    let begin = Instant::now();
    let mut before = (frame_number(), DWT::cycle_count());
    while since(begin) < FRAME_EDGE_LIMIT {
        yield_now().await;
        let now = (frame_number(), DWT::cycle_count());
        if now.0 != before.0 && now.1.wrapping_sub(before.1) <= FRAME_EDGE_CYCLES {
            return Some(now);
        }
        before = now;
    }
    None
}

/// Counts about [`FRAMES`] frames; none without a host that sends them.
async fn count_frames() -> Option<ClockCount> {
    let first = frame_edge().await?;
    let mut passed = 0u32;
    let mut before = first.0;
    while passed < FRAMES {
        // Edges are searched all the time, so a frame number cannot wrap unnoticed.
        let (frame, cycle) = frame_edge().await?;
        passed += u32::from(frame.wrapping_sub(before) & FRAME_MASK);
        before = frame;
        if passed >= FRAMES {
            return Some(ClockCount {
                periods: passed,
                cycles: cycle.wrapping_sub(first.1).into(),
            });
        }
    }
    None
}

/// Returns the time since `begin`, or zero if the clock reads earlier now than then, for which `Instant::elapsed`
/// panics. The clock steps back if it began half a turn ahead, see `boot/clock.rs`. If its interrupt is masked for
/// longer than half a turn, for example while a sector of the settings is erased, the clock may step back again.
pub fn since(begin: Instant) -> Duration {
    Instant::now().saturating_duration_since(begin)
}
