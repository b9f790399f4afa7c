//! Marks of the worst cases, under the most that the device does at once, and levels of the sensors.

use model_format::link::{Marks, MotionSource, Setting, Settings, StatusEndpoint, UploadProgress};
use postcard_rpc::Endpoint;
use virtual_stylus::Options;
use virtual_stylus::model::flash::Stalls;
use virtual_stylus::sensors;
use virtual_stylus::sensors::FunctionPins;

use crate::device::{Device, MS, PERIOD_NS, frame};
use crate::library;
use crate::scenes;

/// Cycles of the processor per microsecond.
const CYCLES_PER_US: u32 = 400;

/// Most of the stack that may be used, bytes: five sixths of it.
const MOST_STACK_BYTES: u32 = 40 << 10;
/// Longest delay of the tick.
const MOST_TICK_DELAY_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest critical section.
const MOST_MASKED_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest time between two feeds of the watchdog, whose period is 250 ms.
const MOST_GAP_US: u32 = 100_000;

/// Checks the bounds, and that each mark was made.
fn check(marks: Marks) {
    println!("{marks:?}");
    assert_eq!(marks.stack_bytes, 48 << 10);
    assert!(
        (1024..=MOST_STACK_BYTES).contains(&marks.stack_used_bytes),
        "{marks:?}"
    );
    assert!(
        (1..=MOST_TICK_DELAY_CYCLES).contains(&marks.longest_tick_delay_cycles),
        "{marks:?}"
    );
    assert!(
        (1..=MOST_MASKED_CYCLES).contains(&marks.longest_critical_section_cycles),
        "{marks:?}"
    );
    assert!(
        (20_000..=MOST_GAP_US).contains(&marks.longest_watchdog_gap_us),
        "{marks:?}"
    );
}

#[test]
fn marks_keep_their_bounds_while_a_scene_plays_and_is_recorded_a_library_comes_and_both_links_are_busy()
 {
    /// Bytes that are uploaded: enough for every task to meet every other.
    const UPLOADED: usize = 40_000;
    const PIECE: usize = 2_000;
    let mut device = Device::on_usb(library::with(&scenes::bytes()));
    device.stylus.set_pins(FunctionPins(scenes::tapping));
    // To and fro over the boundary, where two surfaces sound.
    let turns = (0..40).map(|turn| (turn * 200, if turn % 2 == 0 { 240.0 } else { -200.0 }));
    device.move_along(&turns.collect::<Vec<_>>());
    device
        .play_scene("everything", MotionSource::Sensors, 3)
        .expect("it is in the library");
    device.record();
    let large = library::large();
    let mut progress = device.begin_upload(&large);
    let mut asked = 0;
    let mut answered = 0;
    for end in (PIECE..=UPLOADED).step_by(PIECE) {
        // The other link asks for the status, which is its longest answer.
        asked += 1;
        let mut bytes = cobs::encode_vec(&frame(StatusEndpoint::REQ_KEY, asked, &()));
        bytes.push(0);
        device.send_bytes(&bytes);
        device.send_chunks(&large, progress, end);
        progress = UploadProgress {
            next_offset: end.next_multiple_of(model_format::link::MAX_CHUNK_BYTES) as u32,
            ..progress
        };
        let sent = device.stylus.receive();
        answered += sent.iter().filter(|sent| sent.byte == 0).count();
    }
    assert!(
        answered as u32 > asked / 2,
        "{answered} of {asked} answered"
    );
    device.run_for(1_000 * MS);
    device.assert_undisturbed();
    check(device.status().marks);
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
}

#[test]
fn settings_are_written_and_erased_while_ticks_go_on_and_nothing_waits_for_the_bank() {
    let mut device = Device::started(library::options());
    for value in [100.0, 150.0] {
        device.set(Setting::SoftStart, value);
    }
    device.reset_settings().expect("they are erased");
    let operations = device.stylus.flash_operations();
    assert!(operations.len() > 3, "{operations:?}");
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
    device.assert_undisturbed();
    let marks = device.status().marks;
    assert!(marks.longest_watchdog_gap_us <= MOST_GAP_US, "{marks:?}");
}

#[test]
fn levels_are_those_of_the_signals_on_the_pins() {
    /// Codes to either side of the mean.
    const ACCELERATION: u16 = 1_000;
    const FORCE: u16 = 20;
    const FORCE_MEAN: u16 = 20_000;
    const VOLT_PER_CODE: f64 = 3.3 / 65_536.0;
    let mut device = Device::started(library::options());
    let pins = FunctionPins(|channel, at_ns: u64| {
        let up = (at_ns / PERIOD_NS).is_multiple_of(2);
        let around = |mean: u16, codes| if up { mean + codes } else { mean - codes };
        match channel {
            5 => around(FORCE_MEAN, FORCE),
            15 => around(0x8000, ACCELERATION),
            _ => 0x8000,
        }
    });
    device.stylus.set_pins(pins);
    device.run_for(2_100 * MS);
    let levels = device.status().levels;
    assert_eq!(levels.samples, 5_000);
    // By default 29.72 m/s²/V and 2 N/V.
    let decibel = |codes: u16, per_volt: f64| {
        20.0 * (f64::from(codes) * VOLT_PER_CODE * per_volt * 1e6).log10()
    };
    let vibration = decibel(ACCELERATION, 29.72);
    assert!(
        (f64::from(levels.vibration_decibel) - vibration).abs() < 0.02,
        "{levels:?}, {vibration}"
    );
    let noise = decibel(FORCE, 2.0);
    assert!(
        (f64::from(levels.force_noise_decibel) - noise).abs() < 0.02,
        "{levels:?}, {noise}"
    );
    let zero = Settings::default().get(Setting::ForceZero);
    let force = (f64::from(FORCE_MEAN) - f64::from(zero)) * VOLT_PER_CODE * 2.0;
    assert!(
        (f64::from(levels.force_newton) - force).abs() < 1e-3,
        "{levels:?}, {force}"
    );
}

#[test]
fn a_device_that_was_never_set_reads_the_force_and_the_path_that_the_virtual_stylus_means_by_default()
 {
    /// Channel of the force sensor by default.
    const FORCE_CHANNEL: u8 = 5;
    let mut device = Device::started(Options::default());
    let settings = device.settings();
    assert_eq!(settings, Settings::default(), "it was never set");
    let path = f64::from(settings.get(Setting::PathPerCount));
    assert!(
        (path / sensors::mm_per_count() - 1.0).abs() < 1e-6,
        "{path}"
    );
    for newton in [0.0, 0.8, 2.5] {
        let volts = sensors::force_zero_volts() + newton / sensors::newtons_per_volt();
        let code = (volts / sensors::REFERENCE_VOLTS * sensors::FULL_SCALE).round() as u16;
        let pins = FunctionPins(move |channel, _| match channel {
            FORCE_CHANNEL => code,
            _ => 0x8000,
        });
        device.stylus.set_pins(pins);
        device.run_for(2_100 * MS);
        let read = f64::from(device.status().levels.force_newton);
        assert!((read - newton).abs() < 1e-3, "{read} N for {newton} N");
    }
}
