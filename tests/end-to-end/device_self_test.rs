//! `stylus selftest`: a healthy device passes, each fault is named together with its remedy, and a record is kept.

use std::time::Duration;

use crate::support::{Bench, connected, holds, json, started, text};
use fake_stylus::library::library;
use fake_stylus::{Board, FakeStylus, Hand};
use host_tools::procedures::self_test::{self, Options, Verdict};
use serde_json::Value;

/// A tool that lies still: noise of the converters, and a force within its range.
fn lying() -> Hand {
    Hand {
        force_n: 2.0,
        acceleration: (0..997u32)
            .map(|n| [0, 1, 2].map(|axis| 32_760 + ((n * n + axis * 7) % 16) as u16))
            .collect(),
        force_noise: 3,
        ..Hand::default()
    }
}

/// A device on `board` that lies still.
fn on(board: Board) -> (FakeStylus, Bench) {
    let (stylus, bench) = started();
    stylus.set_hand(lying());
    stylus.set_board(board);
    (stylus, bench)
}

/// Runs a self test, and returns its record and its exit code.
fn test(bench: &Bench, arguments: &str) -> (Value, i32) {
    let output = bench.run(&format!("selftest --seconds 0.5 --json {arguments}"));
    let code = output.status.code().expect("it ends by itself");
    (json(&text(&output.stdout)), code)
}

/// Names of the lines with `verdict`.
fn with<'a>(record: &'a Value, verdict: &str) -> Vec<&'a str> {
    let lines = record["lines"].as_array().expect("lines");
    (lines.iter())
        .filter(|line| line["verdict"] == verdict)
        .map(|line| line["name"].as_str().expect("a name"))
        .collect()
}

#[test]
fn no_test_code_is_put_out_unless_the_enable_is_wired_or_a_person_says_that_no_amplifier_is_connected() {
    let (stylus, bench) = on(Board::default());
    for (wired, flags, moves) in [
        (0, "", false),
        (0, "--bare", false),
        (0, "--bare --no-amplifier", true),
        // What the earlier flags stated applied to that run only.
        (0, "--bare --use-slot B", false),
        (1, "--bare", true),
        (1, "--bare --no-amplifier", true),
    ] {
        bench.succeed(&format!("settings set enable-wired {wired} --yes"));
        let before = stylus.test_codes();
        let (record, code) = test(&bench, flags);
        assert_eq!((with(&record, "fail"), code), (vec![], 0));
        let codes = stylus.test_codes() - before;
        assert_eq!(codes > 0, moves, "{codes} codes: {wired}, {flags}");
        let is_left_out = with(&record, "not_measured").contains(&"output");
        assert_eq!(is_left_out, !moves);
        let says_what_to_do = record.to_string().contains("test with --no-amplifier");
        assert_eq!(says_what_to_do, !moves);
    }
}

#[test]
fn a_healthy_device_passes_and_leaves_a_record() {
    let (_stylus, bench) = on(Board::default());
    let (record, code) = test(&bench, "");
    assert_eq!(with(&record, "fail"), [""; 0], "{record:#}");
    assert_eq!(code, 0);
    assert!(with(&record, "pass").len() > 40, "{record:#}");
    assert_eq!(record["device"]["serial"], "0123456789ABCDEF01234567");
    assert_eq!(record["failed"], 0);
    let names = bench.names();
    assert_eq!(names.len(), 1, "{names:?}");
    let begin = "selftest-0123456789ABCDEF01234567-20";
    assert!(names[0].starts_with(begin), "{names:?}");
    assert!(names[0].ends_with("Z.json"), "{names:?}");
    assert_eq!(bench.report(&names[0]), record);
    // The record is written to the named file, and the table is printed.
    let shown = bench.succeed("selftest --bare --seconds 0.2 --record here.json");
    assert!(bench.path("here.json").is_file());
    holds(&shown, &["silicon revision", "V (0x2003)", "pass"]);
    holds(&shown, &["record: here.json", "0 fail"]);
}

#[test]
fn traffic_is_tested_while_a_texture_is_played_silently() {
    let (_stylus, bench) = on(Board::default());
    bench.write("a.lib", library(1, 20, 1));
    bench.succeed("upload a.lib --activate");
    let (record, code) = test(&bench, "--bare");
    assert_eq!(code, 0, "{record:#}");
    let lines = record["lines"].as_array().expect("lines");
    let loaded = lines
        .iter()
        .find(|line| line["name"].as_str().expect("a name").ends_with("kernel loaded"));
    assert_eq!(loaded.expect("it is there")["value"], "by texture 0");
    let status = bench.json("status --json");
    assert_eq!(status["status"]["output"]["activity"], "Idle");
    assert_eq!(status["status"]["record"]["recording"], false);
}

#[test]
fn a_line_of_the_encoder_that_is_stuck_is_named() {
    let board = Board {
        stuck_line: Some(true),
        ..Board::default()
    };
    let (stylus, _bench) = on(board);
    let failing = || {
        let device = connected(&stylus);
        let options = Options {
            traffic_s: 0.1,
            rest_s: 0.1,
            move_s: 1.5,
            moves: true,
            ..Options::default()
        };
        self_test::run(&device, &options, |_| ())
            .unwrap()
            .into_iter()
            .filter(|line| line.verdict == Verdict::Fail)
            .map(|line| line.name)
            .collect::<Vec<_>>()
    };
    // The first speed is in step with nothing. At the second speed the tool moves by 20 counts, five periods of both
    // lines, in each block of a recording.
    for speed_mm_s in [30.7, 31.25] {
        stylus.set_hand(Hand { speed_mm_s, ..lying() });
        let failing = failing();
        let has = |name: &str| failing.iter().any(|failing| failing == name);
        assert!(has("encoder line A"), "{failing:?}");
        assert!(!has("encoder line B"), "{failing:?}");
        assert!(!has("encoder direction"), "{failing:?}");
    }
    // A tool that nobody moves fails by its counts.
    stylus.set_board(Board::default());
    stylus.set_hand(lying());
    assert!(failing().contains(&"encoder counts moved".to_owned()));
}

#[test]
fn a_second_link_that_cannot_be_opened_is_an_error_before_anything_is_measured() {
    let (stylus, bench) = on(Board::default());
    holds(
        &bench.fail("selftest --also tcp:127.0.0.1:1 --seconds 0.1"),
        &["127.0.0.1:1"],
    );
    assert_eq!(stylus.count("stylus/selftest"), 0);
    assert_eq!(bench.names(), [""; 0]);
}

#[test]
fn a_second_link_has_the_timeout_that_is_given() {
    let (stylus, bench) = on(Board::default());
    let other = FakeStylus::start();
    other.fail(|faults| {
        // Later than the usual timeout.
        faults.late = Duration::from_millis(1_300);
        faults.disguise = Some(|info| info.serial = "another".parse().unwrap());
    });
    let refused = bench.refuse(&format!("selftest --also {} --timeout 600", other.link()));
    holds(&refused, &["this is device another"]);
    assert_eq!(stylus.count("stylus/selftest"), 0);
}
