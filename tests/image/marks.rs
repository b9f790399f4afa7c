//! The device's records of its worst cases (`Marks`), under the highest load, and levels of the sensors.

use fake_stylus::requests::frame;
use model_format::link::{Marks, Setting, StatusEndpoint};
use postcard_rpc::Endpoint;
use virtual_stylus::model::flash::Stalls;
use virtual_stylus::sensors::FunctionPins;

use crate::device::{Device, MS};
use crate::library;
use crate::scenes;

/// Cycles of the processor per microsecond.
const CYCLES_PER_US: u32 = 400;

/// Largest part of the stack that may be used, bytes: three quarters, as in the self test.
const MOST_STACK_BYTES: u32 = (53 << 10) / 4 * 3;
/// Longest permitted delay of the tick, cycles.
const MOST_TICK_DELAY_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest permitted critical section, cycles.
const MOST_MASKED_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest permitted time between two feeds of the watchdog, µs. Its period is 100 ms, and 250 ms during the start.
const MOST_GAP_US: u32 = 50_000;

/// Checks that every mark was recorded and is within its bound.
fn check(marks: Marks) {
    println!("{marks:?}");
    assert_eq!(marks.stack_bytes, 53 << 10);
    let made = [
        (marks.stack_used_bytes, 1024),
        (marks.longest_tick_delay_cycles, 1),
        (marks.longest_critical_section_cycles, 1),
        (marks.longest_watchdog_gap_us, 20_000),
    ];
    assert!(made.iter().all(|(mark, least)| mark >= least), "{marks:?}");
    check_bounds(marks);
}

/// Checks that every mark is within its bound.
pub fn check_bounds(marks: Marks) {
    let bounds = [
        (marks.stack_used_bytes, MOST_STACK_BYTES),
        (marks.longest_tick_delay_cycles, MOST_TICK_DELAY_CYCLES),
        (marks.longest_critical_section_cycles, MOST_MASKED_CYCLES),
        (marks.longest_watchdog_gap_us, MOST_GAP_US),
    ];
    assert!(bounds.iter().all(|(mark, most)| mark <= most), "{marks:?}");
}

#[test]
fn marks_keep_their_bounds_while_a_scene_plays_and_is_recorded_a_library_comes_and_both_links_are_busy() {
    /// Number of bytes that are uploaded, enough for every task to run at the same time as every other.
    const UPLOADED: usize = 40_000;
    const PIECE: usize = 2_000;
    let mut device = Device::on_usb(library::with(&scenes::bytes()));
    device.stylus.set_pins(FunctionPins(scenes::tapping));
    // The tool moves forward and back over the boundary, where two surfaces sound.
    let turns = (0..40).map(|turn| (turn * 200, if turn % 2 == 0 { 240.0 } else { -200.0 }));
    device.move_along(&turns.collect::<Vec<_>>());
    device.play_scene("everything", 3);
    device.record();
    let large = library::large();
    let mut next = device.begin_upload(&large);
    let mut asked = 0;
    let mut answered = 0;
    for end in (PIECE..=UPLOADED).step_by(PIECE) {
        // The other link requests the status, which is the longest answer on that link.
        asked += 1;
        let mut bytes = cobs::encode_vec(&frame(StatusEndpoint::REQ_KEY, asked, &()));
        bytes.push(0);
        device.send_bytes(&bytes);
        next = device.send_chunks(&large, next, end);
        let sent = device.stylus.receive();
        answered += sent.iter().filter(|sent| sent.byte == 0).count();
    }
    assert!(answered as u32 > asked / 2, "{answered} of {asked} answered");
    device.run_for(1_000 * MS);
    device.assert_undisturbed();
    check(device.status().marks);
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
}

#[test]
fn settings_are_written_and_erased_while_ticks_go_on_and_nothing_waits_for_the_bank() {
    let mut device = Device::with_library();
    device.set(Setting::SoftStart, 100.0);
    device.reset_settings().expect("they are erased");
    let operations = device.stylus.flash_operations();
    assert!(operations.len() > 3, "{operations:?}");
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
    device.assert_undisturbed();
    let marks = device.status().marks;
    assert!(marks.longest_watchdog_gap_us <= MOST_GAP_US, "{marks:?}");
}
