//! Frames of USB in cycles of the core.

use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::USB_OTG_FS;
use embassy_time::{Duration, Instant};
use model_format::link::ClockCount;

use crate::boot::clock::CORE_HZ;
use crate::self_test::time::since;

/// Frames to count: one second.
const FRAMES: u32 = 1_000;

/// Frame numbers have eleven bits at full speed (RM0433, OTG_DSTS).
const FRAME_MASK: u16 = 0x7ff;

/// Longest time between two looks around an edge: 50 ppm of the second.
const EDGE_CYCLES: u32 = CORE_HZ / 20_000;

/// Time within which an edge is found.
const EDGE_LIMIT: Duration = Duration::from_millis(300);

fn number() -> u16 {
    USB_OTG_FS.dsts().read().fnsof() & FRAME_MASK
}

/// Waits for the beginning of a frame, seen to within [`EDGE_CYCLES`]; returns its number and the core's cycle.
async fn edge() -> Option<(u16, u32)> {
    let begin = Instant::now();
    let mut before = (number(), DWT::cycle_count());
    while since(begin) < EDGE_LIMIT {
        yield_now().await;
        let now = (number(), DWT::cycle_count());
        if now.0 != before.0 && now.1.wrapping_sub(before.1) <= EDGE_CYCLES {
            return Some(now);
        }
        before = now;
    }
    None
}

/// Counts about [`FRAMES`] frames; none without a host that sends them.
pub async fn count() -> Option<ClockCount> {
    let first = edge().await?;
    let mut passed = 0u32;
    let mut before = first.0;
    while passed < FRAMES {
        // Edges are looked for all the time, so a frame number cannot wrap unseen.
        let (frame, cycle) = edge().await?;
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
