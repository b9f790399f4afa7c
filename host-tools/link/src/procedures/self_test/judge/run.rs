//! The device's own counters, and the link under load.

use std::time::Duration;

use model_format::SAMPLE_RATE_HZ;
use model_format::link::{BLOCK_SAMPLES, ClockSource, LinkCounters, Marks, StartReport, Status};

use crate::link::capture::Loss;
use crate::procedures::self_test::line::Line;

/// Longest tick, per cent of its period.
const TICK_PERCENT: f64 = 80.0;

/// Largest part of the stack that was ever used, per cent.
const STACK_PERCENT: f64 = 75.0;

/// Longest delay from the timer's trigger to the tick, µs. The tick must finish reading its row within 29 µs of the
/// trigger.
const TICK_DELAY_US: f64 = 20.0;

/// Longest critical section, µs. It delays a tick by its own duration.
const MASKED_US: f64 = 15.0;

/// Longest time between two feeds of the watchdog, ms. The watchdog resets the device after 100 ms.
const WATCHDOG_GAP_MS: f64 = 50.0;

/// Largest round trip of a request while a recording streams, ms, and largest median of all round trips, ms.
const ROUND_TRIP_MS: [f64; 2] = [500.0, 100.0];

/// Least part of the blocks due between the two statuses that must be received, per cent. Not all of them can be,
/// because the recording begins after the first status and ends before the second.
const RECEIVED_PERCENT: f64 = 50.0;

/// Traffic of the link for some time.
#[derive(Clone, Debug)]
pub struct Traffic {
    /// Status before.
    pub before: Status,
    /// Status after.
    pub after: Status,
    /// Losses of the recording.
    pub loss: Loss,
    /// Duration of each request with its answer.
    pub round_trips: Vec<Duration>,
}

fn faults(counters: &LinkCounters) -> u32 {
    counters
        .malformed
        .saturating_add(counters.oversized)
        .saturating_add(counters.line_errors)
        .saturating_add(counters.unsent)
}

const REPORT: &str = "report the device's build with the record of this test";
const AGAIN: &str = "restart and test again; if it stays, report the device's build with the record of this test";
const SIMPLER: &str = "play a simpler scene; if a texture alone takes too long, report the build with the record of \
                       this test";

/// Judges what `status` counted since the start.
pub fn state(status: &Status) -> Vec<Line> {
    let histogram = &status.tick_histogram;
    let period = f64::from(histogram.core_hz / SAMPLE_RATE_HZ);
    let fault = match &status.fault {
        Some(fault) => format!("{:?} at {:#010x}", fault.kind, fault.program_counter),
        None => "none".to_owned(),
    };
    let mut lines = started(status.start);
    lines.extend(worst(&status.marks, histogram.core_hz));
    lines.push(Line::exact(
        "fault since power-on",
        fault,
        "none",
        "report it with the fault's line of `status`; switch the power off and on to clear it",
    ));
    let tick = &status.tick;
    lines.extend(
        [
            ("ticks missed since the start", tick.missed, AGAIN),
            ("frames late since the start", tick.late_frames, SIMPLER),
            ("conversions late since the start", tick.late_conversions, AGAIN),
            ("outputs late since the start", tick.late_outputs, AGAIN),
        ]
        .map(|(name, count, remedy)| Line::none(name, count, remedy)),
    );
    let longest = 100.0 * f64::from(histogram.longest) / period;
    let limits = (0.0, TICK_PERCENT);
    lines.push(Line::number(
        "longest tick",
        longest,
        limits,
        ("% of its period", 1),
        SIMPLER,
    ));
    lines
}

/// Judges the start.
fn started(start: StartReport) -> Vec<Line> {
    let [clock, _] = super::board::words(start.board);
    vec![
        Line::exact(
            "clock",
            start.clock.to_string(),
            ClockSource::External.to_string(),
            &format!("the board's clock did not come: {clock}, and restart"),
        ),
        Line::exact(
            "safe mode",
            if start.safe_mode { "yes" } else { "no" },
            "no",
            "three starts ended in a fault: find it in `status`, remove its cause, then switch the power off and on",
        ),
        Line::exact(
            "supply",
            if start.supply_low { "low" } else { "good" },
            "good",
            "flash is not written below 2.76 V: use a better cable or supply",
        ),
    ]
}

/// Judges the worst cases since the start.
fn worst(marks: &Marks, core_hz: u32) -> Vec<Line> {
    let micros = |cycles: u32| f64::from(cycles) * 1e6 / f64::from(core_hz);
    let stack = 100.0 * f64::from(marks.stack_used_bytes) / f64::from(marks.stack_bytes.max(1));
    let delay = micros(marks.longest_tick_delay_cycles);
    let masked = micros(marks.longest_critical_section_cycles);
    let gap = f64::from(marks.longest_watchdog_gap_us) / 1e3;
    [
        ("stack used", stack, STACK_PERCENT, ("%", 1)),
        ("trigger to tick", delay, TICK_DELAY_US, ("µs", 2)),
        ("masked interrupts", masked, MASKED_US, ("µs", 2)),
        ("watchdog gap", gap, WATCHDOG_GAP_MS, ("ms", 1)),
    ]
    .map(|(name, value, most, unit)| Line::number(name, value, (0.0, most), unit, REPORT))
    .into()
}

/// Judges the traffic of `link`.
pub fn traffic(link: &str, values: &Traffic) -> Vec<Line> {
    const CABLE: &str = "close other programs that use the link, use another cable, without a hub, and test again";
    let Traffic { before, after, .. } = values;
    let name = |what: &str| format!("{link}: {what}");
    // The counters wrap; the difference is right all the same.
    let during = |count: fn(&Status) -> u32| count(after).wrapping_sub(count(before));
    let mut trips: Vec<f64> = (values.round_trips.iter())
        .map(|trip| trip.as_secs_f64() * 1e3)
        .collect();
    trips.sort_by(f64::total_cmp);
    // Without a round trip both values are NaN, which no limit passes.
    let median = trips.get(trips.len() / 2).copied().unwrap_or(f64::NAN);
    let longest = trips.last().copied().unwrap_or(f64::NAN);
    let loss = &values.loss;
    let ticks = after.tick.ticks.saturating_sub(before.tick.ticks);
    let due = (ticks as f64 / BLOCK_SAMPLES as f64).max(1.0);
    let mut lines = vec![Line::number(
        name("blocks received"),
        100.0 * f64::from(loss.received) / due,
        (RECEIVED_PERCENT, 100.0),
        ("% of those due", 1),
        CABLE,
    )];
    let faults = during(|status| faults(&status.usb).saturating_add(faults(&status.serial)));
    for (what, count) in [
        ("blocks lost in the device", loss.in_device.into()),
        ("blocks lost on the link", loss.on_link.into()),
        ("frames broken", loss.broken_frames),
        ("faults of the link", faults.into()),
    ] {
        lines.push(Line::none(name(what), count, CABLE));
    }
    for (what, trip, most) in [
        ("round trip, longest", longest, ROUND_TRIP_MS[0]),
        ("round trip, median", median, ROUND_TRIP_MS[1]),
    ] {
        lines.push(Line::number(name(what), trip, (0.0, most), ("ms", 1), CABLE));
    }
    for (what, count) in [
        ("ticks missed", during(|status| status.tick.missed)),
        ("frames late", during(|status| status.tick.late_frames)),
        ("conversions late", during(|status| status.tick.late_conversions)),
        ("outputs late", during(|status| status.tick.late_outputs)),
    ] {
        lines.push(Line::none(name(what), count, REPORT));
    }
    lines
}
