//! `stylus selftest`: a healthy device passes, each fault is named with what to do, and a record is kept.

use crate::support::{Bench, json, text};
use fake_stylus::library::library;
use fake_stylus::{Board, FakeStylus, Faults, Hand};
use model_format::link::SelfTestError;
use serde_json::Value;

/// A hand that lets the tool lie: noise of the converters, and a force within its range.
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

/// A device that lies still, on `board`.
fn on(board: Board) -> (FakeStylus, Bench) {
    let (stylus, bench) = (FakeStylus::start(), Bench::new());
    stylus.set_hand(lying());
    stylus.set_board(board);
    (stylus, bench)
}

/// The record of a self test, and its exit code.
fn test(stylus: &FakeStylus, bench: &Bench, arguments: &str) -> (Value, i32) {
    let output = bench.run(&format!(
        "selftest --seconds 0.5 --json {arguments} --link {}",
        stylus.link()
    ));
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

/// Tests `board`: the lines `expected` fail, each with a remedy, and the exit code says so.
fn finds(board: Board, expected: &[&str]) {
    let (stylus, bench) = on(board);
    let (record, code) = test(&stylus, &bench, "");
    assert_eq!(with(&record, "fail"), expected, "{record:#}");
    assert_eq!(code, 2);
    let lines = record["lines"].as_array().expect("lines");
    for line in lines.iter().filter(|line| line["verdict"] == "fail") {
        let remedy = line["remedy"].as_str().expect("a remedy");
        assert!(remedy.len() > 20, "{line}");
    }
}

#[test]
fn a_healthy_device_passes_and_leaves_a_record() {
    let (stylus, bench) = on(Board::default());
    let (record, code) = test(&stylus, &bench, "");
    assert_eq!(with(&record, "fail"), [""; 0], "{record:#}");
    assert_eq!(code, 0);
    assert!(with(&record, "pass").len() > 40, "{record:#}");
    assert_eq!(record["device"]["serial"], "0123456789ABCDEF01234567");
    assert_eq!(record["failed"], 0);
    let names = bench.names();
    assert_eq!(names.len(), 1, "{names:?}");
    assert!(
        names[0].starts_with("selftest-0123456789ABCDEF01234567-20")
            && names[0].ends_with("Z.json"),
        "{names:?}"
    );
    let file = std::fs::read_to_string(bench.path(&names[0])).expect("it is there");
    assert_eq!(json(&file), record);
    // A file by name, and the table.
    let shown = bench.succeed(&format!(
        "selftest --seconds 0.2 --record here.json --link {}",
        stylus.link()
    ));
    assert!(bench.path("here.json").is_file());
    for words in [
        "silicon revision",
        "V (0x2003)",
        "pass",
        "record: here.json",
        "0 fail",
    ] {
        assert!(shown.contains(words), "{words} is not in:\n{shown}");
    }
}

#[test]
fn traffic_is_tested_while_a_texture_is_played_silently() {
    let (stylus, bench) = on(Board::default());
    bench.write("a.lib", library(1, 20, 1));
    bench.succeed(&format!("upload a.lib --activate --link {}", stylus.link()));
    let (record, code) = test(&stylus, &bench, "");
    assert_eq!(code, 0, "{record:#}");
    let lines = record["lines"].as_array().expect("lines");
    let loaded = lines.iter().find(|line| {
        let name = line["name"].as_str().expect("a name");
        name.ends_with("kernel loaded")
    });
    assert_eq!(loaded.expect("it is there")["value"], "by texture 0");
    let status = json(&bench.succeed(&format!("status --json --link {}", stylus.link())));
    assert_eq!(status["status"]["output"]["activity"], "Idle");
    assert_eq!(status["status"]["record"]["recording"], false);
}

#[test]
fn wrong_silicon_and_option_bytes_are_named() {
    let mut board = Board::default();
    board.chip.revision = 0x1003;
    board.chip.flash_kb = 1024;
    finds(board, &["silicon revision", "flash size"]);
    let mut board = Board::default();
    board.chip.device = 0x483;
    board.chip.unique_id[1] ^= 1;
    finds(board, &["chip", "unique id"]);
    let mut board = Board::default();
    board.option_bytes.status = 0x2000_55E0;
    board.option_bytes.banks_swapped = true;
    board.option_bytes.writable_sectors = [0xff, 0x7f];
    board.option_bytes.read_protected[0] = 0x0010_0000;
    board.option_bytes.boot = 0x1FF0_2000;
    let named = [
        "read protection",
        "brown-out level",
        "watchdog by",
        "banks swapped",
        "writable sectors",
        "protected areas",
        "boot address",
        "pins for low voltage",
    ];
    finds(board, &named);
}

#[test]
fn clocks_that_disagree_are_named() {
    let mut board = Board::default();
    // HSI in place of the crystal may be off by a per cent.
    let usb = board.clocks.usb_frames.as_mut().expect("it is connected");
    usb.cycles += usb.cycles / 100;
    finds(board, &["core against USB"]);
    let mut board = Board::default();
    board.clocks.low_speed = None;
    finds(board, &["LSI"]);
    let mut board = Board::default();
    board.clocks.ticks.cycles *= 2;
    finds(board, &["ticks against core"]);
}

#[test]
fn errors_of_memories_are_named() {
    let mut board = Board::default();
    board.error_correction.ram[0] = 0b001;
    board.error_correction.ram[3] = 0b010;
    board.error_correction.flash_corrected[1] = 3;
    board.error_correction.flash_failed[0] = 1;
    let named = [
        "RAM errors corrected",
        "RAM errors not corrected",
        "flash bank 1 errors not corrected",
        "flash bank 2 errors corrected",
    ];
    finds(board, &named);
}

#[test]
fn faults_of_the_output_are_named() {
    let with = |pin: fn(f64) -> f64| Board {
        output: Ok(Board::output(pin)),
        ..Board::default()
    };
    finds(with(|_| 1300.0), &["output at PA4"]);
    finds(with(|code| code + 40.0), &["output offset"]);
    // Bit 6 is stuck at zero.
    let stuck = with(|code| f64::from(code as u16 & !(1 << 6)));
    let (stylus, bench) = on(stuck);
    let (record, _) = test(&stylus, &bench, "");
    let found = self::with(&record, "fail");
    assert!(found.contains(&"output smallest step"), "{found:?}");
    let mut slow = Board::output(|code| code);
    slow.step_words = [1024 * 16; 16];
    slow.noise = 100.0;
    let board = Board {
        output: Ok(slow),
        ..Board::default()
    };
    finds(board, &["output noise", "output delay", "output settled"]);
    let silent = Board {
        output: Err(SelfTestError::Hardware {
            what: "ADC2 does not convert".try_into().expect("it is short"),
        }),
        ..Board::default()
    };
    finds(silent, &["output"]);
}

#[test]
fn a_slow_flash_is_named_and_a_library_is_erased_only_on_request() {
    let board = Board {
        flash_us: 5_000_000,
        ..Board::default()
    };
    finds(board, &["slot A sector erase", "slot A word write, mean"]);
    // Both slots hold a library.
    let (stylus, bench) = on(Board::default());
    for name in ["a.lib", "b.lib"] {
        bench.write(name, library(1, 20, 1));
        bench.succeed(&format!(
            "upload {name} --activate --link {}",
            stylus.link()
        ));
    }
    let slots = || json(&bench.succeed(&format!("list --json --link {}", stylus.link())));
    let before = slots();
    let (record, code) = test(&stylus, &bench, "");
    assert_eq!(code, 0, "{record:#}");
    assert!(with(&record, "not_measured").contains(&"flash"));
    assert_eq!(slots(), before);
    let spare = before
        .as_array()
        .expect("two slots")
        .iter()
        .find(|slot| slot["active"] == false)
        .expect("one is not active")["slot"]
        .as_str()
        .expect("a letter")
        .to_owned();
    let (record, code) = test(&stylus, &bench, &format!("--use-slot {spare}"));
    assert_eq!(code, 0, "{record:#}");
    assert_ne!(slots(), before);
}

#[test]
fn noise_a_rail_a_hum_and_a_stuck_converter_are_named() {
    let (stylus, bench) = on(Board::default());
    let period = 5_000 / 50;
    let disturbed = |n: usize| {
        let phase = std::f64::consts::TAU * n as f64 / f64::from(period);
        let quiet = 32_760 + (n * n % 16) as u16;
        let hum = (f64::from(quiet) + 4_000.0 * phase.sin()) as u16;
        [hum, 3, quiet]
    };
    stylus.set_hand(Hand {
        acceleration: (0..period as usize).map(disturbed).collect(),
        speed_mm_s: 20.0,
        ..lying()
    });
    let (record, code) = test(&stylus, &bench, "");
    assert_eq!(code, 2);
    let found = with(&record, "fail");
    for name in [
        "acceleration X noise",
        "acceleration X hum of 50 Hz",
        "acceleration Y from the rails",
        "acceleration Y converts",
        "encoder counts at rest",
    ] {
        assert!(found.contains(&name), "{name}: {found:?}");
    }
    let bare = test(&stylus, &bench, "--bare");
    assert_eq!(bare.1, 0, "{:#}", bare.0);
}

#[test]
fn a_line_of_the_encoder_that_is_stuck_is_named() {
    let board = Board {
        stuck_line: Some(true),
        ..Board::default()
    };
    let (stylus, bench) = on(board);
    // The first is in step with nothing. The second moves by 20 counts, five periods of both lines, in each block of a
    // recording.
    for speed_mm_s in [30.7, 31.25] {
        stylus.set_hand(Hand {
            speed_mm_s,
            ..lying()
        });
        let (record, code) = test(&stylus, &bench, "--move");
        assert_eq!(code, 2);
        let found = with(&record, "fail");
        assert!(found.contains(&"encoder line A"), "{found:?}");
        assert!(!found.contains(&"encoder line B"), "{found:?}");
        assert!(!found.contains(&"encoder direction"), "{found:?}");
    }
    // Up and down by one: the tool shakes, or one line is stuck.
    stylus.set_board(Board::default());
    stylus.set_hand(lying());
    let (record, _) = test(&stylus, &bench, "--move");
    let found = with(&record, "fail");
    assert!(found.contains(&"encoder counts moved"), "{found:?}");
}

#[test]
fn a_link_that_loses_blocks_is_named() {
    let (stylus, bench) = on(Board::default());
    stylus.fail(Faults {
        lose_block_every: Some(9),
        ..Faults::default()
    });
    let (record, code) = test(&stylus, &bench, "--bare");
    assert_eq!(code, 2);
    let link = stylus.link();
    let lost = format!("{link}: blocks lost on the link");
    assert!(with(&record, "fail").contains(&lost.as_str()), "{record:#}");
}

#[test]
fn a_second_link_that_cannot_be_opened_is_an_error_before_anything_is_measured() {
    let (stylus, bench) = on(Board::default());
    let other = bench.run(&format!(
        "selftest --also tcp:127.0.0.1:1 --seconds 0.1 --link {}",
        stylus.link()
    ));
    assert_eq!(other.status.code(), Some(2));
    let message = text(&other.stderr);
    assert!(message.contains("127.0.0.1:1"), "{message}");
    assert_eq!(stylus.count("stylus/selftest"), 0);
    assert_eq!(bench.names(), [""; 0]);
}

#[test]
fn a_record_without_a_folder_is_an_error_before_anything_is_measured() {
    let (stylus, bench) = on(Board::default());
    let output = bench.run(&format!(
        "selftest --record nowhere/record.json --link {}",
        stylus.link()
    ));
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("nowhere/record.json: there is no folder nowhere"));
    assert_eq!(stylus.count("stylus/selftest"), 0);
}
