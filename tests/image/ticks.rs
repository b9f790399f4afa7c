//! Cost of a tick, and which memory it touches; and the device's records of its worst cases (`Marks`) under the highest
//! load.

use std::path::Path;
use std::sync::LazyLock;

use fake_stylus::requests::frame;
use model_format::link::{Marks, Setting, StatusEndpoint};
use postcard_rpc::Endpoint;
use virtual_stylus::model::flash::Stalls;
use virtual_stylus::sensors::FunctionPins;
use virtual_stylus::tick::TickStatistics;

use crate::device::{Device, MS};
use crate::page::Page;
use crate::{library, scenes};

/// The texture that is played, and its name in the page.
const PLAYED: (&str, &str) = ("lattice", "lattice, order 400");

/// Ticks that play [`PLAYED`], and the limits that acted on them.
static PLAYING: LazyLock<(TickStatistics, Limited)> = LazyLock::new(|| playing(&[]));

/// Ticks that play nothing: without and with recording.
static AT_REST: LazyLock<[TickStatistics; 2]> = LazyLock::new(at_rest);

/// Cycles per instruction of the virtual stylus, for a core at 400 MHz.
const CYCLES_PER_INSTRUCTION: u32 = 2;
/// Cycles per period at 400 MHz.
const PERIOD_CYCLES: u32 = 80_000;
/// Two sets of settings: with the first, the limits of each code act on [`PLAYED`]; with the second, the thermal
/// limiter does.
const TIGHT: [&[(Setting, f32)]; 2] = [
    &[
        (Setting::OutputGain, 0.2),
        (Setting::PowerLimit, 1.0),
        (Setting::HardLimit, 0.02),
        (Setting::SlewLimit, 0.1),
    ],
    &[(Setting::OutputGain, 0.2), (Setting::PowerLimit, 0.001)],
];
/// Largest part of the period that playing may take, percent.
const MOST_PERCENT: u32 = 20;

fn ticks(device: &mut Device) -> TickStatistics {
    device.stylus.take_ticks();
    device.run_for(300 * MS);
    let ticks = device.stylus.take_ticks();
    TickStatistics::of(&ticks).expect("there were ticks")
}

/// Number of ticks at which each limit acted: hard limit, slew limit, thermal limiter.
type Limited = [u32; 3];

fn limited(device: &mut Device) -> Limited {
    let output = device.status().output;
    [output.hard_limited, output.slew_limited, output.thermally_limited]
}

/// Ticks that play with `settings`, and the limits that acted on them.
fn playing(settings: &[(Setting, f32)]) -> (TickStatistics, Limited) {
    let mut device = Device::with_library();
    for &(setting, value) in settings {
        device.set(setting, value);
    }
    device.set_pins(|channel, at_ns| match channel {
        5 => 9_000 + (at_ns / 50_000) as u16 % 9_000,
        _ => 0x8000,
    });
    device.move_along(&[(0, 10.0), (1_500, 300.0)]);
    device.play_until_heard(PLAYED.0);
    // A prime, so that the audits fall on every place in a block of ten ticks.
    device.stylus.audit_ticks(251);
    device.run_for(200 * MS);
    let audits = device.stylus.take_audits();
    assert!(audits.len() >= 3, "{} audits", audits.len());
    for audit in audits {
        assert_eq!((audit.flash_fetches, audit.flash_reads), (0, 0), "{audit:x?}");
    }
    let before = limited(&mut device);
    let statistics = ticks(&mut device);
    assert_eq!(device.stylus.unfollowed_ticks(), 0);
    let after = limited(&mut device);
    let acted = std::array::from_fn(|limit| after[limit] - before[limit]);
    (statistics, acted)
}

fn at_rest() -> [TickStatistics; 2] {
    let mut device = Device::with_library();
    let idle = ticks(&mut device);
    device.record();
    [idle, ticks(&mut device)]
}

fn show(what: &str, statistics: TickStatistics) {
    let TickStatistics { min, median, max, .. } = statistics;
    println!("instructions a tick, {what}: {min} / {median} / {max}");
}

#[test]
fn a_tick_that_plays_takes_at_most_a_fifth_of_its_period_and_never_touches_flash() {
    let (statistics, _) = *PLAYING;
    show("playing", statistics);
    let cycles = statistics.max * CYCLES_PER_INSTRUCTION;
    assert!(cycles * 100 <= PERIOD_CYCLES * MOST_PERCENT, "{statistics:?}");
}

#[test]
fn a_tick_that_plays_nothing_takes_less_and_recording_adds_nothing_to_it() {
    let [idle, recording] = *AT_REST;
    show("idle", idle);
    show("recording", recording);
    assert!(idle.max * CYCLES_PER_INSTRUCTION * 25 <= PERIOD_CYCLES, "{idle:?}");
    // The tick passes every sample on, whether it is recorded or not.
    assert!(recording.max.abs_diff(idle.max) <= 8, "{idle:?}, {recording:?}");
}

#[test]
fn a_tick_takes_the_same_instructions_whether_limits_act_on_it_or_not() {
    let (free, acted) = *PLAYING;
    assert_eq!(acted, [0; 3], "no limit acts");
    let least_and_most = |statistics: TickStatistics| [statistics.min, statistics.median, statistics.max];
    for (settings, limits) in TIGHT.into_iter().zip([0..2, 2..3]) {
        let (limited, acted) = playing(settings);
        show("limited", limited);
        println!("ticks at which the limits acted: {acted:?}");
        // Each limit must act on at least a tenth of the ticks.
        let some = limited.ticks as u32 / 10;
        assert!(acted[limits].iter().all(|&ticks| ticks > some), "{acted:?}");
        assert_eq!(least_and_most(limited), least_and_most(free));
    }
    // All ticks are alike except those that begin a block.
    assert_eq!(free.min, free.median);
}

/// The lines of the page's block: a row for each kind of tick, and the compiler.
fn table(compiler: &str) -> String {
    let rows = [(AT_REST[0], "idle"), (AT_REST[1], "recording"), (PLAYING.0, PLAYED.1)]
        .into_iter()
        .map(|(statistics, name)| {
            let TickStatistics { min, median, max, .. } = statistics;
            format!("| {name} | {min} | {median} | {max} |\n")
        });
    format!(
        "| tick | fewest | median | most |\n|---|---|---|---|\n{}\nBuilt by rustc {compiler}.\n",
        rows.collect::<String>()
    )
}

/// Compares the page's figures if this image was built with the compiler that the page names. `cargo tasks tables
/// ticks` makes this test write them.
#[test]
fn the_page_has_the_ticks_of_this_image() {
    const TABLE: &str = "ticks";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../firmware/README.md");
    let compiler =
        std::env::var("STYLUS_COMPILER").expect("set STYLUS_COMPILER, as `cargo tasks test-virtual-stylus` does");
    let mut page = Page::read(&path).unwrap_or_else(|error| panic!("{error}"));
    let made = table(&compiler);
    let checked = if std::env::var_os("STYLUS_WRITE_TABLES").is_some() {
        page.write(TABLE, &made).map(|_| ())
    } else if page
        .block(TABLE)
        .is_ok_and(|block| !block.contains(&format!("rustc {compiler}")))
    {
        println!("rustc {compiler} is not the page's: no comparison");
        Ok(())
    } else {
        page.check(TABLE, &made)
    };
    checked.unwrap_or_else(|error| panic!("{error}"));
}

/// Cycles of the processor per microsecond.
const CYCLES_PER_US: u32 = 400;

/// Largest part of the stack that may be used, bytes: three quarters, as in the self test.
const MOST_STACK_BYTES: u32 = (53 << 10) / 4 * 3;
/// Longest permitted delay of the tick, cycles.
const MOST_TICK_DELAY_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest permitted critical section, cycles.
const MOST_MASKED_CYCLES: u32 = 5 * CYCLES_PER_US;
/// Longest permitted time between two feeds of the watchdog, µs. Its period is 100 ms, and 250 ms during the start.
pub const MOST_GAP_US: u32 = 50_000;

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
