//! Cycles of the tick and of the update for every texture and scene of the suite, by the device's own cycle counter.

use model_format::SAMPLE_RATE_HZ;
use model_format::link::{CycleReport, MotionSource, Selection};

use crate::bench::DeviceUnderTest;
use crate::error::Result;

/// Time for which a selection plays before it is measured, ms of the device.
const RUN_UP_MS: u64 = 200;

/// Ticks from the request for an update to the block that the update decides (`stylus_app::UPDATE_LEAD_TICKS`).
const UPDATE_TICKS: u32 = 3;

/// Measures the idle device, and the device while it plays each of `selections`.
pub fn check(bench: &mut DeviceUnderTest, selections: &[(String, Selection)]) -> Result<()> {
    bench.device.take_cycles()?;
    bench.wait(bench.lengths.play_ms)?;
    let idle = bench.device.take_cycles()?;
    tell(bench, "idle", &idle);
    for (what, selection) in selections {
        let length = bench.lengths.play_ms;
        let measured = bench.while_playing(selection, MotionSource::Host, |bench| {
            bench.wait_until_heard()?;
            bench.wait(RUN_UP_MS)?;
            bench.device.take_cycles()?;
            bench.wait(length)?;
            Ok(bench.device.take_cycles()?)
        });
        let (report, _) = measured?;
        tell(bench, what, &report);
    }
    Ok(())
}

/// Adds a line: the tick must end within its period, and the update before its block begins.
fn tell(bench: &mut DeviceUnderTest, what: &str, report: &CycleReport) {
    let CycleReport { core_hz, tick, update } = report;
    let tick_cycles = core_hz / SAMPLE_RATE_HZ;
    let update_cycles = tick_cycles * UPDATE_TICKS;
    bench.judge(
        what,
        format!(
            "tick {} to {}, update {} to {} cycles{}",
            tick.shortest,
            tick.longest,
            update.shortest,
            update.longest,
            if bench.is_emulated() { ", emulated" } else { "" }
        ),
        format!("tick {tick_cycles}, update {update_cycles}"),
        tick.runs > 0 && update.runs > 0 && tick.longest < tick_cycles && update.longest < update_cycles,
    );
}
