//! The suite on a fake device. It finds nothing on a healthy device, and finds each injected defect.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use fake_stylus::{FakeStylus, Faults, Hand};
use hil::bench::{DeviceUnderTest, Lengths};
use hil::board::Board;
use hil::checks::{faults, playing, silent, timing};
use hil::library::{Played, played};
use hil::suite::{Kept, run};
use model_format::link::{Activity, Setting, SettingChange};
use stylus_link::link::{Device, Timeouts};
use stylus_link::procedures::self_test::Verdict;

const LENGTHS: Lengths = Lengths {
    play_ms: 40,
    record_ms: 300,
    endurance_ms: 500,
    between_uploads_ms: 0,
};

/// Timeout of an answer that only a fault reaches, however busy this computer is.
const ANSWER: Duration = Duration::from_mins(10);

fn connected(stylus: &FakeStylus) -> Device {
    connected_with(stylus, Timeouts::scaled_to(ANSWER))
}

fn connected_with(stylus: &FakeStylus, timeouts: Timeouts) -> Device {
    let address = stylus.link().parse().expect("it is an address");
    Device::connect(&address, timeouts).expect("it listens")
}

/// Waits until `count` requests for `path` have arrived.
fn wait_for(stylus: &FakeStylus, path: &str, count: usize) {
    while stylus.count(path) < count {
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn of(device: Device) -> DeviceUnderTest {
    DeviceUnderTest::new(device, Board::ByHand, LENGTHS, Arc::default(), |test| {
        println!("{test}");
    })
}

fn bench(stylus: &FakeStylus) -> DeviceUnderTest {
    stylus.set_hand(Hand::moving(120.0, 1.0));
    of(connected(stylus))
}

/// Returns a bench whose device holds the suite's library.
fn bench_with_library(stylus: &FakeStylus) -> (DeviceUnderTest, Played) {
    let mut bench = bench(stylus);
    Kept::save(&bench, None)
        .expect("the device answers")
        .make_playable(&bench)
        .expect("the device takes them");
    let played = played();
    silent::check_upload(&mut bench, &played.bytes).expect("the device takes it");
    assert_eq!(failed(&bench), [""; 0]);
    (bench, played)
}

/// The names of the tests that failed.
fn failed(bench: &DeviceUnderTest) -> Vec<&str> {
    bench
        .report
        .with(Verdict::Fail)
        .map(|test| test.line.name.as_str())
        .collect()
}

#[test]
fn a_healthy_device_passes_and_is_left_silent_with_its_own_settings() {
    let stylus = FakeStylus::start();
    let device = connected(&stylus);
    let own = SettingChange {
        setting: Setting::SoftStart,
        value: 123.0,
    };
    let before = device.set(own).expect("it is in range");
    drop(device);
    let mut bench = bench(&stylus);
    bench.no_amplifier = true;
    run(&mut bench, None).expect("the device is as it was");
    assert_eq!(failed(&bench), [""; 0]);
    assert!(bench.report.holds());
    assert!(bench.report.with(Verdict::Pass).count() > 30);
    assert_eq!(bench.device.settings().expect("it answers"), before);
    let status = bench.device.status().expect("it answers");
    assert_eq!(status.output.activity, Activity::Idle);
    assert!(status.output.at_rest && !status.record.recording);
}

#[test]
fn the_output_is_left_out_unless_the_enable_is_wired_or_a_person_says_that_no_amplifier_is_connected() {
    let stylus = FakeStylus::start();
    for (wired, no_amplifier) in [(0.0, false), (0.0, true), (1.0, false), (1.0, true)] {
        let mut bench = bench(&stylus);
        bench.no_amplifier = no_amplifier;
        let change = SettingChange {
            setting: Setting::EnableWired,
            value: wired,
        };
        bench.device.reset_settings().expect("it is idle");
        bench.device.set(change).expect("it is in range");
        let before = stylus.test_codes();
        let plays = stylus.count("stylus/play");
        run(&mut bench, None).expect("the device is as it was");
        assert_eq!(failed(&bench), [""; 0]);
        let moves = wired == 1.0 || no_amplifier;
        assert_eq!(stylus.count("stylus/play") > plays, moves);
        assert_eq!(stylus.test_codes() > before, moves, "{wired} {no_amplifier}");
        let mut tests = bench.report.with(Verdict::NotMeasured);
        let left_out = tests.find(|test| test.subject == "self test" && test.line.name == "output");
        assert_eq!(left_out.is_some(), !moves);
        assert!(left_out.is_none_or(|test| test.line.remedy.contains("--no-amplifier")));
    }
}

#[test]
fn without_a_probe_resets_and_faults_are_left_out_with_the_reason() {
    let stylus = FakeStylus::start();
    let mut bench = bench(&stylus);
    faults::check(&mut bench).expect("the device answers");
    let [left_out] = bench.report.tests.as_slice() else {
        panic!("{:?}", bench.report.tests);
    };
    assert_eq!(left_out.line.verdict, Verdict::NotMeasured);
    assert_eq!(
        left_out.line.name,
        "every fault ends in silence, a reset and its reason"
    );
    assert!(left_out.line.remedy.contains("--flash"), "{left_out}");
}

/// Asserts that, on a device with the suite's library and then `faults`, `check` fails only in the test `name`.
fn finds(
    faults: impl FnOnce(&mut Faults),
    check: impl FnOnce(&mut DeviceUnderTest, &Played) -> hil::report::Result<()>,
    name: &str,
) {
    let stylus = FakeStylus::start();
    let (mut bench, played) = bench_with_library(&stylus);
    stylus.fail(faults);
    check(&mut bench, &played).expect("the device answers");
    assert_eq!(failed(&bench), [name]);
}

#[test]
fn an_output_that_goes_on_after_a_lost_link_is_found() {
    let check = |bench: &mut DeviceUnderTest, played: &Played| {
        let (_, scene) = played.selections.last().expect("there are some");
        playing::check(bench, scene)
    };
    // A motion that becomes stale also mutes, but for another reason.
    let name = "a lost link is silent within 100 ms";
    finds(|faults| faults.ignores_lost_link = true, check, name);
}

#[test]
fn ticks_that_are_missed_late_or_too_long_are_found() {
    let endures = |bench: &mut DeviceUnderTest, played: &Played| timing::check_endurance(bench, &played.bytes);
    finds(|f| f.misses_ticks = true, endures, "meanwhile: ticks missed");
    finds(|f| f.puts_out_late = true, endures, "meanwhile: outputs late");
    // The first range of durations includes all earlier ticks, and is not reported.
    let idle = |bench: &mut DeviceUnderTest, _: &Played| timing::check_cycles(bench, &[]);
    finds(|f| f.slower_by = 80_000, idle, "idle");
}

#[test]
fn a_pin_that_is_not_at_mid_scale_is_found_although_the_device_says_that_it_rests() {
    let stylus = FakeStylus::start();
    let mut bench = bench(&stylus);
    stylus.set_board(fake_stylus::Board {
        rest: Ok(fake_stylus::Board::rest(2348.0)),
        ..fake_stylus::Board::default()
    });
    let status = bench.device.status().expect("it answers");
    assert!(status.output.at_rest);
    silent::at_mid_scale(&mut bench, "the pin").expect("the device answers");
    assert_eq!(failed(&bench), ["the pin: output at rest"]);
}

#[test]
fn a_device_that_refuses_is_a_failure_of_each_subject_and_not_the_end_of_the_run() {
    let stylus = FakeStylus::start();
    stylus.fail(|faults| faults.busy_from = Some("stylus/upload/begin"));
    // A busy device is asked until this timeout has passed.
    let timeouts = Timeouts {
        flash: Duration::from_secs(1),
        ..Timeouts::scaled_to(ANSWER)
    };
    let refused = || {
        let mut bench = of(connected_with(&stylus, timeouts));
        assert!(run(&mut bench, None).is_err());
        bench
    };
    let mut bench = refused();
    // On a busy computer the timeout may also pass before the first request that is refused.
    while stylus.count("stylus/upload/begin") == 0 {
        bench = refused();
    }
    assert!(!bench.report.holds());
    let failed = bench.report.with(Verdict::Fail);
    let subjects: Vec<_> = failed.map(|test| test.subject).collect();
    for subject in ["upload", "play", "endurance", "cycles", "end"] {
        assert!(subjects.contains(&subject), "{subjects:?}");
    }
}

#[test]
fn an_interrupt_ends_the_run_in_silence_and_with_the_settings_restored() {
    let stylus = FakeStylus::start();
    let mut bench = bench(&stylus);
    let before = bench.device.settings().expect("it answers");
    let interrupt = bench.interrupt.clone();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // After the first settings were changed, and before the last test.
            wait_for(&stylus, "stylus/play", 1);
            interrupt.store(true, Ordering::Relaxed);
        });
        run(&mut bench, None).expect("the device is as it was");
    });
    assert!(bench.report.interrupted && !bench.report.holds());
    assert_eq!(bench.device.settings().expect("it answers"), before);
    let status = bench.device.status().expect("it answers");
    assert_eq!(status.output.activity, Activity::Idle);
    assert!(status.output.at_rest && !status.record.recording);
}
