//! Recording from a stylus: the set holds what was on the pins, without holes, and a fit can read it.

use std::io::Write;
use std::process::{Child, Output};
use std::time::Duration;

use crate::support::{Bench, all_pole, holds, interrupt, near, noise, reported, started, text, wait_for};
use fake_stylus::{FakeStylus, Hand};
use model_format::AdcCode;
use serde_json::Value;

/// Default scale of the accelerometer, m/s² per V.
const SCALE: f64 = 29.72;

/// A hand over a surface whose vibration is autoregressive.
fn hand(speed_mm_s: f64, force_n: f64) -> Hand {
    let seed = (speed_mm_s * 10.0 + force_n) as u64;
    let vibration = all_pole(&[-1.2, 0.7], &noise(seed, 25_000));
    let code = |x: f64| (32_768.0 + 900.0 * x).round().clamp(0.0, 65_535.0) as u16;
    let codes = vibration.iter().map(|&x| [code(x), code(0.5 * x), code(-0.3 * x)]);
    Hand {
        speed_mm_s,
        force_n,
        acceleration: codes.collect(),
        ..Hand::default()
    }
}

/// A stylus that a hand moves at 100 mm/s and 1 N, and a folder whose commands use its link.
fn moved() -> (FakeStylus, Bench) {
    let (stylus, bench) = started();
    stylus.set_hand(hand(100.0, 1.0));
    (stylus, bench)
}

fn record(bench: &Bench, arguments: &str) -> Output {
    bench.run(&format!("record set {arguments} --json"))
}

fn spawn(bench: &Bench, arguments: &str) -> Child {
    let fixed = ["record", "set", "--json"];
    bench.spawn(fixed.into_iter().chain(arguments.split_whitespace()))
}

/// Reads the samples of a trial, m/s², as a fit does.
fn samples(bench: &Bench, trial: usize) -> Vec<Vec<f64>> {
    let set = host_tools::recording::RecordingSet::open(&[bench.path("set")]).unwrap();
    host_tools::recording::read(&set.trials[trial]).unwrap().axes
}

#[test]
fn what_is_recorded_is_what_was_on_the_pins_and_a_fit_takes_it() {
    let (stylus, bench) = started();
    for (speed, force) in [(120.0, 1.0), (60.0, 1.0), (60.0, 0.5)] {
        let hand = hand(speed, force);
        stylus.set_hand(hand.clone());
        let arguments = format!("--texture silk --speeds {speed} --forces {force} --yes");
        let report = reported(&record(&bench, &arguments));
        let row = &report["recorded"][0];
        assert_eq!(row["verdicts"], serde_json::json!([]), "{row}");
        near(row["level"]["speed_mm_s"].as_f64().unwrap(), speed, 0.5);
        near(row["level"]["force_n"].as_f64().unwrap(), force, 0.01);
        assert_eq!(report["lost_blocks"], 0);
        assert_eq!(row["holes"], 0);
        let list = text(&bench.read("set/trials.csv"));
        let axes = samples(&bench, list.lines().count() - 2);
        assert_eq!(axes[0].len(), 10_000);
        // The recording may begin anywhere in the signal's loop.
        let codes: Vec<[i64; 3]> = (0..10_000)
            .map(|n| {
                let code = |axis: usize| {
                    let volts = axes[axis][n] / SCALE;
                    (volts / f64::from(AdcCode::STEP.0)).round() as i64 + 32_768
                };
                [code(0), code(1), code(2)]
            })
            .collect();
        let pins = hand.acceleration.iter().map(|codes| codes.map(i64::from));
        let pins: Vec<[i64; 3]> = pins.collect();
        let looped = [&pins[..], &pins].concat();
        let begins = (0..pins.len()).find(|&at| looped[at..at + 10_000] == codes[..]);
        assert!(begins.is_some(), "it is no stretch of what was on the pins");
    }
    let said = bench.succeed("fit set --out silk.lib --order 10");
    holds(&said, &["3 trials -> silk.lib"]);
}

#[test]
fn trials_that_are_there_are_not_recorded_again_unless_asked() {
    let (stylus, bench) = moved();
    let first = "--texture silk --speeds 100 --forces 1 --seconds 0.4 --settle 0 --yes";
    reported(&record(&bench, first));
    stylus.take_heard();
    let both = "--texture silk --speeds 100,200 --forces 1 --seconds 0.4 --settle 0 --yes";
    let second = reported(&record(&bench, both));
    assert_eq!(second["already_there"], 1);
    assert_eq!(second["recorded"].as_array().unwrap().len(), 1);
    assert_eq!(stylus.count("stylus/record/start"), 1);
    // The hand is too slow, which the report states.
    let verdicts = &second["recorded"][0]["verdicts"];
    holds(verdicts, &["instead of 200 mm/s"]);
    let before = samples(&bench, 0);
    let again = reported(&record(&bench, &format!("{first} --again --scale 10")));
    assert_eq!(again["recorded"].as_array().unwrap().len(), 1);
    let list = text(&bench.read("set/trials.csv"));
    assert_eq!(list.lines().count(), 3, "{list}");
    assert_ne!(samples(&bench, 0), before);
}

#[test]
fn a_hole_makes_a_trial_begin_anew_and_the_loss_is_told() {
    let (stylus, bench) = moved();
    // A stretch has 63 blocks, and the 40th is lost.
    stylus.fail(|faults| faults.lose_block_every = Some(40));
    let arguments = "--texture silk --speeds 100 --forces 1 --settle 0 --yes";
    let failed = bench.fail(&format!("record set {arguments} --seconds 0.4"));
    holds(&failed, &["without a hole", "on the link"]);
    assert!(!bench.path("set/trials.csv").exists());
    let report = reported(&record(&bench, &format!("{arguments} --seconds 0.24")));
    let row = &report["recorded"][0];
    // 38 blocks fit between two holes, but not always before the first hole.
    assert!(row["holes"].as_u64().unwrap() <= 2, "{row}");
    assert_eq!(samples(&bench, 0)[0].len(), 1200);
}

#[test]
fn what_the_device_loses_is_told_apart_from_what_the_link_loses() {
    let (stylus, bench) = moved();
    stylus.lose_samples(Duration::from_millis(300), 100);
    let report = reported(&record(&bench, "--texture silk --speeds 100 --forces 1 --yes"));
    let row = &report["recorded"][0];
    let lost = row["loss"]["in_device"].as_u64().unwrap();
    assert!((4..=5).contains(&lost), "{row}");
    assert_eq!(row["loss"]["on_link"], 0, "{row}");
    assert_eq!(row["holes"], 1, "{row}");
    assert_eq!(report["lost_blocks"], lost);
}

#[test]
fn torn_samples_are_told_and_interpolated_and_too_many_are_no_recording() {
    for (torn, is_kept) in [(40, true), (2_000, false)] {
        let (stylus, bench) = moved();
        stylus.tear_samples(Duration::from_millis(1_200), torn);
        let output = record(&bench, "--texture silk --speeds 100 --forces 1 --yes");
        if is_kept {
            let row = &reported(&output)["recorded"][0];
            assert_eq!(row["interpolated"], torn, "{row}");
            let told = row["loss"]["torn_samples"].as_u64();
            assert!(told >= Some(torn.into()), "{row}");
        } else {
            holds(&text(&output.stderr), &["of 10000 samples are torn"]);
        }
    }
}

#[test]
fn the_person_at_the_keyboard_says_what_is_recorded_kept_and_left_out() {
    let (stylus, bench) = moved();
    bench.write(
        "points.csv",
        "texture,speed_mm_s,force_n\nsilk,100,1\nsilk,200,1\nfelt,100,1\nfelt,50,1\nfelt,40,1\n",
    );
    let mut child = spawn(&bench, "--trials points.csv --seconds 0.5 --settle 0");
    let mut keyboard = child.stdin.take().unwrap();
    // The first trial is good. The second is too slow; it is repeated, and then kept. The third is left out. At the
    // fourth the operator ends the session.
    keyboard.write_all(b"\n\nr\n\n\ns\nq\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stderr);
    let report = reported(&output);
    assert_eq!(report["recorded"].as_array().unwrap().len(), 2, "{said}");
    assert_eq!(report["left_out"], 3);
    assert_eq!(stylus.count("stylus/record/start"), 3);
    holds(&said, &["[2/5] silk, 200 mm/s, 1 N", "instead of 200 mm/s"]);
    let set = host_tools::recording::RecordingSet::open(&[bench.path("set")]).unwrap();
    let listed: Vec<f64> = set.trials.iter().map(|trial| trial.speed_mm_s).collect();
    assert_eq!(listed, [100.0, 200.0]);
    // In a second session, one trial is left out, one is kept although it is too slow, and then the session ends.
    let mut child = spawn(&bench, "--trials points.csv --seconds 0.5 --settle 0");
    let mut keyboard = child.stdin.take().unwrap();
    keyboard.write_all(b"s\n\nq\n").unwrap();
    let second = reported(&child.wait_with_output().unwrap());
    assert_eq!(second["already_there"], 2);
    assert_eq!(second["recorded"][0]["speed_mm_s"], 50.0);
    assert_eq!(second["left_out"], 2);
}

#[test]
fn a_recording_that_was_to_be_made_again_is_told_as_long_as_it_is_in_the_folder() {
    // The first trial is too slow, and what follows the request for another recording is not that.
    for (keys, left_out) in [("\nr\ns\nq\n", 1), ("\nr\nq\n", 1), ("\nr\ns\n\n\n", 0)] {
        let (_stylus, bench) = moved();
        let trials = "--texture silk --speeds 200,300 --forces 1 --seconds 0.5 --settle 0";
        let mut child = spawn(&bench, trials);
        let mut keyboard = child.stdin.take().unwrap();
        keyboard.write_all(keys.as_bytes()).unwrap();
        let report = reported(&child.wait_with_output().unwrap());
        let recorded = report["recorded"].as_array().unwrap();
        let list = text(&bench.read("set/trials.csv"));
        assert_eq!(recorded.len(), list.lines().count() - 1, "{report}");
        assert_eq!(recorded[0]["speed_mm_s"], 200.0);
        assert_eq!(report["left_out"], left_out);
    }
}

#[test]
fn triage_judges_each_trial_when_it_is_there() {
    let (stylus, bench) = started();
    let clipped = |(index, codes): (usize, [u16; 3])| {
        let top = if (index / 20).is_multiple_of(2) {
            65_535
        } else {
            codes[0]
        };
        [top, codes[1], codes[2]]
    };
    let good = hand(100.0, 1.0);
    let codes = good.acceleration.iter().copied().enumerate();
    let loud: Vec<[u16; 3]> = codes.map(clipped).collect();
    // In the air the samples do not matter: the only finding is that nothing moved.
    stylus.set_hand(Hand {
        acceleration: Vec::clone(&loud),
        ..hand(0.0, 0.0)
    });
    let air = "--texture air --speeds 100 --forces 1 --yes";
    let said = reported(&record(&bench, air));
    let verdicts = said["recorded"][0]["verdicts"].as_array().unwrap();
    assert_eq!(verdicts.len(), 1, "{said}");
    let words = "nothing moved: the sensors say 0.0 mm/s and 0.00 N";
    holds(&verdicts[0], &[words]);
    for (texture, acceleration, word) in [("still", vec![[32_768; 3]], "silent"), ("loud", loud, "clipped")] {
        stylus.set_hand(Hand {
            acceleration,
            ..good.clone()
        });
        let arguments = format!("--texture {texture} --speeds 100 --forces 1 --yes");
        let report = reported(&record(&bench, &arguments));
        holds(&report["recorded"][0]["verdicts"], &[word]);
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_trial_without_a_trace_of_it() {
    let (stylus, bench) = moved();
    let long = "--texture silk --speeds 100 --forces 1 --seconds 60 --yes";
    let child = spawn(&bench, long);
    wait_for("the recording", || stylus.count("stylus/record/start") > 0);
    interrupt(&child);
    let report = reported(&child.wait_with_output().unwrap());
    assert_eq!(report["left_out"], 1);
    assert_eq!(report["recorded"], Value::Array(vec![]));
    assert!(!bench.path("set/trials.csv").exists());
    let status = bench.json("status --json");
    assert_eq!(status["status"]["record"]["recording"], false);
}

#[test]
fn a_recording_that_was_left_running_is_stopped_by_stop() {
    let (stylus, bench) = moved();
    let mut child = spawn(&bench, "--texture silk --speeds 100 --forces 1 --seconds 60 --yes");
    wait_for("the recording", || stylus.count("stylus/record/start") > 0);
    child.kill().unwrap();
    child.wait().unwrap();
    let arguments = "--texture silk --speeds 100 --forces 1 --yes";
    let refused = bench.fail(&format!("record set {arguments}"));
    holds(&refused, &["a recording is under way: stop it first"]);
    holds(&bench.succeed("stop"), &["stopped recording"]);
    reported(&record(&bench, arguments));
}

/// The columns of a recording of strokes; its header and comments are skipped.
fn columns(bench: &Bench, name: &str) -> Vec<[f64; 6]> {
    let text = text(&bench.read(name));
    let rows = text.lines().filter(|line| !line.starts_with(['#', 't']));
    let row = |line: &str| -> [f64; 6] {
        line.split(',')
            .map(|field| field.parse().unwrap())
            .collect::<Vec<f64>>()
            .try_into()
            .unwrap()
    };
    rows.map(row).collect()
}

#[test]
fn a_free_hands_strokes_are_recorded_cut_and_fitted() {
    let (stylus, bench) = started();
    for (name, speed, force) in [("a.csv", 120.0, 1.0), ("b.csv", 60.0, 0.6)] {
        stylus.set_hand(hand(speed, force));
        let record = format!("record {name} --strokes --seconds 1.5 --json");
        let recorded = bench.json(&record);
        assert_eq!(recorded["lost_samples"], 0);
        assert_eq!(recorded["seconds"], 1.5);
        let rows = columns(&bench, name);
        assert_eq!(rows.len(), 7500);
        let scale = SCALE * f64::from(AdcCode::STEP.0);
        let pins = hand(speed, force).acceleration;
        let codes = |row: &[f64; 6]| [1, 2, 3].map(|axis| (row[axis] / scale).round() as i64 + 32_768);
        let pin = |at: usize| pins[at % pins.len()].map(i64::from);
        let begins = (0..pins.len())
            .find(|&at| (0..20).all(|n| pin(at + n) == codes(&rows[n])))
            .expect("the first samples were on the pins");
        for (n, row) in rows.iter().enumerate() {
            assert_eq!(codes(row), pin(begins + n), "{name}, sample {n}");
            near(row[4], speed, 0.02 * speed);
            near(row[5], force, 0.01);
        }
    }
    let said = bench.succeed("fit a.csv b.csv --strokes --texture silk --out silk.lib --order 10");
    holds(&said, &["-> silk.lib"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_strokes_and_keeps_them_and_what_the_link_loses_is_a_hole() {
    let (stylus, bench) = moved();
    stylus.fail(|faults| faults.lose_block_every = Some(10));
    let child = bench.spawn(["record", "a.csv", "--strokes", "--json"]);
    wait_for("the recording", || stylus.count("stylus/record/start") > 0);
    // Enough blocks for several holes.
    let end = stylus.time() + Duration::from_millis(700);
    wait_for("the blocks", || stylus.time() >= end);
    interrupt(&child);
    let report = reported(&child.wait_with_output().unwrap());
    let rows = columns(&bench, "a.csv");
    let lost = rows.iter().filter(|row| row[1].is_nan()).count() as u64;
    assert!(lost > 0, "{report}");
    assert_eq!(report["lost_samples"], lost);
    // Time continues in the holes, and the speed and force next to them are right.
    for (n, row) in rows.iter().enumerate() {
        near(row[0], n as f64 / 5000.0, 1e-9);
        assert!(row[4].is_nan() || (row[4] - 100.0).abs() < 3.0, "sample {n}: {row:?}");
    }
}

#[test]
fn a_duration_that_no_recording_can_have_is_refused_before_memory_is_taken_for_it() {
    let (_stylus, bench) = started();
    for command in [
        "record set --texture silk --speeds 100 --forces 1 --yes",
        "record strokes.csv --strokes",
    ] {
        holds(
            &bench.fail(&format!("{command} --seconds 1e12")),
            &["more than 8388608 samples"],
        );
    }
}
