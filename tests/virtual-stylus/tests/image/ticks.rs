//! Cost of a tick, and the memory that it touches.

use model_format::link::{MotionSource, RecordStartEndpoint};
use virtual_stylus::motion::Motion;
use virtual_stylus::pins::FunctionPins;
use virtual_stylus::tick::TickStatistics;

use crate::device::{Device, MS};
use crate::library;

/// Cycles per instruction of the virtual stylus, whose core runs at 400 MHz.
const CYCLES_PER_INSTRUCTION: u32 = 2;
/// Cycles of a period at 400 MHz.
const PERIOD_CYCLES: u32 = 80_000;
/// Largest part of the period that playing may take, per cent.
const MOST_PERCENT: u32 = 20;

fn ticks(device: &mut Device) -> TickStatistics {
    device.stylus.take_ticks().expect("the run goes on");
    device.run_for(300 * MS);
    let ticks = device.stylus.take_ticks().expect("the run goes on");
    TickStatistics::of(&ticks).expect("there were ticks")
}

fn playing(texture: &str) -> TickStatistics {
    let mut device = Device::started(library::options());
    let pins = FunctionPins(|channel, at_ns: u64| match channel {
        5 => 9_000 + (at_ns / 50_000) as u16 % 9_000,
        _ => 0x8000,
    });
    device.stylus.set_pins(pins).expect("the run goes on");
    let start = device.stylus.now_ns();
    let speeds = [(start, 10.0), (start + 1_500 * MS, 300.0)];
    let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
    device.stylus.set_motion(motion).expect("the run goes on");
    device.play_until_heard(texture, MotionSource::Sensors, 3);
    device.stylus.audit_ticks(251).expect("the run goes on");
    device.run_for(200 * MS);
    let audits = device.stylus.take_audits().expect("the run goes on");
    assert!(audits.len() >= 3, "{} audits", audits.len());
    for audit in audits {
        assert_eq!(
            (audit.flash_fetches, audit.flash_reads),
            (0, 0),
            "{audit:x?}"
        );
    }
    let statistics = ticks(&mut device);
    assert_eq!(
        device.stylus.unfollowed_ticks().expect("the run goes on"),
        0
    );
    statistics
}

fn show(what: &str, statistics: TickStatistics) {
    let TickStatistics {
        min, median, max, ..
    } = statistics;
    println!("instructions a tick, {what}: {min} / {median} / {max}");
}

#[test]
fn a_tick_that_plays_takes_at_most_a_fifth_of_its_period_and_never_touches_flash() {
    for texture in ["lattice", "direct 32", "direct 16"] {
        let statistics = playing(texture);
        show(texture, statistics);
        let cycles = statistics.max * CYCLES_PER_INSTRUCTION;
        assert!(
            cycles * 100 <= PERIOD_CYCLES * MOST_PERCENT,
            "{texture}: {statistics:?}"
        );
    }
}

#[test]
fn a_tick_that_plays_nothing_takes_less_and_recording_adds_nothing_to_it() {
    let mut device = Device::started(library::options());
    let idle = ticks(&mut device);
    show("idle", idle);
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    let recording = ticks(&mut device);
    show("recording", recording);
    assert!(
        idle.max * CYCLES_PER_INSTRUCTION * 50 <= PERIOD_CYCLES,
        "{idle:?}"
    );
    // The tick passes every sample on, recorded or not.
    assert!(
        recording.max.abs_diff(idle.max) <= 8,
        "{idle:?}, {recording:?}"
    );
}
