//! Commands to a stylus without faults. Each is carried out, and the tests read its effect back.

use std::io::{BufRead, BufReader};
use std::time::Duration;

use crate::support::{
    Bench, attached, connected, holds, interrupt, json, near, play_for, reported, scaled, started, text, wait_for,
};
use fake_stylus::actuator::Actuator;
use fake_stylus::library::{announcement, library};
use fake_stylus::{FakeStylus, Hand};
use model_format::link::{Setting, UploadChunk};
use serde_json::Value;
use stylus_plant::Parameters;

/// A stylus with an active library of one texture, and a folder that holds the library.
pub fn ready() -> (FakeStylus, Bench) {
    let (stylus, bench) = started();
    bench.write("a.lib", library(1, 20, 1));
    bench.succeed("upload a.lib --activate");
    stylus.take_heard();
    (stylus, bench)
}

#[test]
fn a_library_is_uploaded_listed_activated_and_shown() {
    let (_stylus, bench) = started();
    let bytes = library(2, 30, 7);
    bench.write("a.lib", &bytes);
    let uploaded = bench.json("upload a.lib --json");
    assert_eq!(uploaded["bytes"], bytes.len());
    assert_eq!(uploaded["textures"], json(r#"["texture 0", "texture 1"]"#));
    assert_eq!(uploaded["retries"], 0);
    assert_eq!(uploaded["active"], false);
    let slot = uploaded["slot"].as_str().unwrap();
    let before = bench.json("status --json");
    assert_eq!(before["status"]["active"], Value::Null);

    let activated = bench.json("slots --activate --json");
    assert_eq!(activated["slot"], slot);
    let status = bench.json("status --json");
    assert_eq!(status["status"]["active"], slot);
    assert_eq!(status["status"]["library_crc32"], uploaded["crc32"]);
    assert_eq!(status["muted"][0], "not playing");

    let listed = bench.json("slots --json");
    let slots = listed.as_array().unwrap();
    let full = slots.iter().find(|s| s["slot"] == slot).unwrap();
    assert_eq!(full["active"], true);
    assert_eq!(full["textures"][1]["name"], "texture 1");
    assert_eq!(full["textures"][1]["max_order"], 30);
    assert_eq!(full["textures"][1]["provenance"], "SIMULATED");
    holds(&bench.succeed("slots"), &["(active)", "15 x 8"]);
    let status = bench.succeed("status");
    let start = "start NUCLEO-H743ZI2, external clock, silicon revision V (0x2003), brown-out level 3, 0 quick faults";
    holds(&status, &["stylus 0123456789ABCDEF01234567", start, "µs"]);
    holds(&status, &["changing texture or library 1 x"]);
}

#[test]
fn an_abort_ends_the_upload_of_a_command_that_is_gone_and_says_how_far_it_was() {
    let (stylus, bench) = started();
    let bytes = library(1, 20, 3);
    let device = connected(&stylus);
    let slot = device.upload_begin(announcement(&bytes)).unwrap().slot;
    let data = &bytes[..512];
    device.upload_chunk(&UploadChunk { offset: 0, data }).unwrap();
    drop(device);

    let ended = bench.succeed("upload --abort");
    let arrived = format!("512 of {} bytes had arrived", bytes.len());
    holds(&ended, &[&format!("the upload to slot {slot} was ended; {arrived}")]);
    let none = bench.json("upload --abort --json");
    assert_eq!(none, json(r#"{"before": "Idle", "after": "Idle"}"#));
    bench.write("a.lib", &bytes);
    let uploaded = bench.json("upload a.lib --json");
    assert_eq!(uploaded["resumed_from"], 0);
}

#[test]
fn a_constant_motion_is_sent_at_its_rate_until_the_end_and_the_stop_is_read_back() {
    let (stylus, bench) = ready();
    let motion = "--speed 120 --force 0.8 --seconds 2 --rate 200 --json".split(' ');
    let play = ["play", "--texture", "texture 0"].into_iter().chain(motion);
    let output = bench.command(play).output().unwrap();
    let report = reported(&output);
    let number = |name: &str| report[name].as_u64().unwrap();
    // 200 motions are due per second, and those that this computer left out are among them.
    let slots = number("motions") + number("skipped");
    let due = report["seconds"].as_f64().unwrap() * 200.0;
    assert!(due >= 400.0 && slots as f64 <= due + 2.0, "{report}");
    let topics = stylus.count("stylus/motion/live");
    let asked = stylus.count("stylus/motion");
    assert_eq!((topics + asked) as u64, number("motions"));
    assert!(number("acknowledged") <= asked as u64, "{report}");
    // Every 16th motion is a request.
    assert_eq!(asked as u64, number("motions").div_ceil(16), "{report}");
    let heard = stylus.take_heard();
    let mut motions = heard.iter().filter_map(|heard| heard.motion);
    assert!(motions.all(|m| m.speed.0 == 120.0 && m.force.0 == 0.8));
    assert!(heard.iter().any(|heard| heard.path == "stylus/stop"));
    let status = bench.json("status --json");
    assert_eq!(status["status"]["output"]["activity"], "Idle");
}

#[test]
fn a_motion_from_a_file_is_followed_in_time_to_its_end() {
    let (stylus, bench) = ready();
    bench.write("m.csv", "time_s,speed_mm_s,force_n\n0,0,0.5\n1,100,1.5\n");
    let play = ["play", "--texture", "texture 0", "--motion", "m.csv"];
    let child = bench.command(play).args(["--json"]).output().unwrap();
    let report = reported(&child);
    assert!(report["seconds"].as_f64().unwrap() >= 1.0, "{report}");
    let heard = stylus.take_heard().into_iter();
    let motions: Vec<_> = heard.filter_map(|heard| heard.motion).collect();
    assert!(!motions.is_empty());
    for motion in &motions {
        assert!((motion.force.0 - 0.5 - motion.speed.0 / 100.0).abs() < 1e-4);
    }
    assert!(motions.is_sorted_by(|a, b| a.speed.0 < b.speed.0));
}

#[test]
fn along_the_sensors_keep_alives_are_sent_and_ctrl_c_stops() {
    let (stylus, bench) = ready();
    stylus.set_hand(Hand::moving(100.0, 1.0));
    let child = bench.spawn(["play", "--texture", "texture 0", "--json"]);
    wait_for("a hundred keep-alives", || stylus.count("stylus/keep-alive") >= 100);
    #[cfg(unix)]
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    let report = reported(&output);
    assert_eq!(report["motions"], 0);
    // One keep-alive is due per 10 ms, and this computer's delays may only cost some.
    let expected = report["seconds"].as_f64().unwrap() * 100.0;
    let found = report["keep_alives"].as_f64().unwrap();
    assert!((100.0..=expected + 2.0).contains(&found), "{report}");
    let heard = stylus.take_heard();
    assert!(heard.iter().all(|heard| heard.motion.is_none()));
    let status = bench.json("status --json");
    let output = &status["status"]["output"];
    assert_eq!(output["activity"], "Idle");
    // Nothing muted the output between beginning and end.
    assert_eq!(output["mute_counts"][1], 0, "{output}");
}

#[cfg(unix)]
#[test]
fn a_play_in_which_nothing_moves_says_so() {
    let (stylus, bench) = ready();
    for (speed_mm_s, is_still) in [(0.0, true), (100.0, false)] {
        stylus.set_hand(Hand::moving(speed_mm_s, 1.0));
        let play = ["play", "--texture", "texture 0", "--json"];
        let output = play_for(Duration::from_millis(500), &stylus, &bench, play);
        let said = text(&output.stderr).replace("\n  ", " ");
        let told = said.contains("nothing moved, so that nothing was heard");
        assert_eq!(told, is_still, "{said}");
        let report = reported(&output);
        let fastest = report["fastest_mm_s"].as_f64().unwrap();
        assert_eq!(fastest > 0.0, !is_still, "{fastest}");
    }
}

#[cfg(unix)]
#[test]
fn limits_that_acted_are_counted_per_play() {
    let (stylus, bench) = ready();
    bench.succeed("settings set hard-limit 0.01");
    for (gain, is_limited) in [("4", true), ("0", false)] {
        let play = ["play", "--texture", "texture 0", "--gain", gain, "--json"];
        let motion = ["--speed", "100", "--force", "1"];
        let play = play.into_iter().chain(motion);
        let output = play_for(Duration::from_millis(500), &stylus, &bench, play);
        let said = text(&output.stderr).replace("\n  ", " ");
        let report = reported(&output);
        let hard = report["hard_limited"].as_u64().unwrap();
        assert_eq!(hard > 0, is_limited, "{report}");
        assert_eq!(said.contains(&format!("({hard} hard, ")), is_limited, "{said}");
    }
}

#[cfg(unix)]
#[test]
fn a_play_tells_what_the_accelerometer_felt_and_what_the_active_library_lets_expect() {
    let actuator = Actuator::new(Parameters::preset("haptuator").unwrap(), 1, None);
    let (stylus, bench) = attached(FakeStylus::start_on(actuator));
    bench.write("a.lib", library(1, 20, 1));
    bench.write("b.lib", library(1, 20, 2));
    bench.succeed("upload a.lib --activate");
    let texture = ["--texture", "texture 0"];
    let along = "play --speed 120 --force 1 --gain 2 --json --library a.lib"
        .split(' ')
        .chain(texture);
    // The level at the accelerometer is that of a whole second.
    let output = play_for(Duration::from_millis(2_200), &stylus, &bench, along);
    let report = reported(&output);
    let felt = |name: &str| report["accelerometer"][name].as_f64().unwrap();
    assert!(felt("greatest_m_s2") > 2.0 * felt("before_m_s2"), "{report}");
    let render = "render a.lib --speed 120 --force 1 --out a.wav --seconds";
    let render = format!("{render} {}", report["seconds"]);
    let rendered = bench.command(render.split(' ')).args(texture).status();
    assert!(rendered.unwrap().success());
    let rendered = scaled(&bench.samples("a.wav", 5_000), 2.0);
    let rms = (rendered.iter().map(|x| x * x).sum::<f64>() / rendered.len() as f64).sqrt();
    let peak = rendered.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let expected = |name: &str| report["expected"][name].as_f64().unwrap();
    near(expected("rms_m_s2"), rms, 1e-4 * rms);
    near(expected("peak_m_s2"), peak, 1e-4 * peak);
    let other = "play --speed 120 --force 1 --seconds 1 --library b.lib";
    let mut other = bench.command(other.split(' '));
    let other = text(&other.args(texture).output().unwrap().stderr);
    holds(&other, &["b.lib", "not the device's active library", "stylus upload"]);
}

#[test]
fn a_play_asks_for_a_texture_or_a_scene_and_says_where_the_options_of_a_link_belong() {
    let (_stylus, bench) = ready();
    holds(&bench.fail("play"), &["--texture <NAME>|--scene <NAME>"]);
    let named = bench.command(["play", "--scene", "texture 1"]).output().unwrap();
    let words = "has no scene \"texture 1\"; it has none; 'texture 0' is a texture of it";
    holds(&text(&named.stderr).replace("\n  ", " "), &[words]);
    for (arguments, option, after) in [
        ("--link usb status", "--link", ": stylus status --link"),
        ("--timeout 3", "--timeout", ""),
        ("--out a.lib fit x", "--out", ": stylus fit --out"),
    ] {
        let words = format!("'{option}' belongs after the command{after}");
        holds(&bench.fail(arguments), &[&words]);
    }
    assert!(!bench.fail("status --nonsense").contains("belongs after"));
}

#[test]
fn settings_are_shown_changed_read_back_and_reset() {
    let (_stylus, bench) = started();
    let value = |arguments: &str| -> f64 {
        let shown = bench.json(&format!("settings {arguments} --json"));
        shown[0]["value"].as_f64().unwrap()
    };
    assert_eq!(value("get force-per-volt"), 2.0);
    assert_eq!(value("set force-per-volt -3.5"), -3.5);
    assert_eq!(value("get force-per-volt"), -3.5);
    let all = bench.succeed("settings");
    assert_eq!(all.lines().count(), 2 + model_format::link::SETTING_COUNT);
    holds(&all, &["acceleration-per-volt-z", "m/s²/V"]);
    holds(&all, &Setting::ALL.map(Setting::meaning));
    holds(&bench.refuse("settings reset"), &["give --yes"]);
    assert_eq!(value("get force-per-volt"), -3.5);
    bench.succeed("settings reset --yes");
    assert_eq!(value("get force-per-volt"), 2.0);
}

#[test]
fn a_new_stylus_plays_nothing_until_one_command_sets_the_coil() {
    let (_stylus, bench) = attached(FakeStylus::start_unset());
    bench.write("a.lib", library(1, 20, 1));
    bench.succeed("upload a.lib --activate");
    let play = "play --texture absent";
    let refused = bench.refuse(play);
    let missing = "amplifier-gain, coil-resistance, power-limit not set";
    holds(&refused, &[missing, "stylus calibrate", "stylus settings set"]);
    let shown = bench.succeed("settings");
    assert_eq!(shown.matches(" not set ").count(), 3, "{shown}");
    let status = bench.succeed("status");
    holds(&status, &["SETTINGS nothing plays"]);
    let row = bench.json("settings get coil-resistance --json");
    assert_eq!(row[0]["value"], Value::Null);
    assert_eq!(row[0]["state"], "not-set");

    let all = "settings set coil-resistance 8 amplifier-gain 2 power-limit 0.2";
    let refused = bench.refuse(all);
    holds(&refused, &["not set -> 8 Ω", "W held at 8 Ω", "give --yes"]);
    let set = bench.json(&format!("{all} --yes --json"));
    let set = set.as_array().unwrap();
    assert_eq!(set.len(), 3);
    assert!(set.iter().all(|row| row["state"] == "set"), "{set:?}");
    let status = bench.succeed("status");
    assert!(!status.contains("SETTINGS"), "{status}");
    // Only the texture is missing now.
    holds(&bench.refuse(play), &["no texture"]);
    bench.refuse_each("settings set power-limit 0.3 volume 1 | no setting 'volume'");
}

#[test]
fn what_protects_less_is_shown_and_confirmed_and_what_protects_more_is_not_asked_for() {
    let (_stylus, bench) = started();
    let value = |name: &str| {
        let shown = bench.succeed(&format!("settings get {name} --json"));
        json(&shown)[0]["value"].as_f64().unwrap() as f32
    };
    bench.succeed("settings set hard-limit 0.25");
    let looser = "settings set soft-start 300 hard-limit 0.75 force-zero 5000";
    let refused = bench.refuse(looser);
    holds(&refused, &["hard-limit: 0.25 -> 0.75 V", "0.749 V peak"]);
    holds(&refused, &["give --yes"]);
    assert!(!refused.contains("soft-start"), "{refused}");
    // Either both settings change or none: here neither has changed.
    assert_eq!((value("soft-start"), value("force-zero")), (200.0, 4096.0));
    bench.succeed(&format!("{looser} --yes"));
    assert_eq!((value("soft-start"), value("hard-limit")), (300.0, 0.75));
    let refused = bench.refuse("settings set soft-start 300 soft-start 400");
    holds(&refused, &["soft-start is given twice"]);
}

#[test]
fn a_calibration_without_an_answer_stores_nothing_and_asks_for_none_if_told_so() {
    let (_stylus, bench) = attached(FakeStylus::start_unset());
    let coil = "--resistance 8 --amplifier-gain 10 --power-limit 0.5 --hard-limit 0.2";
    let calibrate = format!("calibrate {coil} --seconds 0.3 --json");
    holds(&text(&bench.run(&calibrate).stderr), &["nobody answered"]);
    holds(&bench.refuse("play --texture silk"), &["not set"]);
    let report = bench.json(&format!("{calibrate} --yes"));
    near(report["peak_watts"].as_f64().unwrap(), 0.5, 1e-6);
}

#[test]
fn what_the_device_refuses_is_told_in_its_words_and_what_was_there_stays() {
    let (_stylus, bench) = ready();
    let status = || {
        let status = bench.json("status --json");
        ["active", "library_crc32"].map(|key| status["status"][key].clone())
    };
    let before = status();
    bench.refuse_each(
        "settings set hard-limit 5 | hard-limit of 5; it must be 0.001 to 1.45 V
        settings set force-per-volt 0 | must be -100 to 100 N/V, and not between -0.001 and 0.001
        settings set hard-limit NaN | hard-limit of NaN
        settings set force-zero 1.5 | a whole number
        play --texture absent --speed 1 --force 1 | no texture \"absent\"; it has texture 0
        play --scene absent --speed 1 --force 1 | no scene \"absent\"; it has none",
    );
    assert_eq!(status(), before);
    let set = bench.json("settings get hard-limit --json");
    assert_eq!(set[0]["value"], 0.5);
}

#[test]
fn without_a_library_there_is_nothing_to_play_or_activate() {
    let (_stylus, bench) = started();
    bench.refuse_each(
        "play --texture silk | no library is active
        slots --activate | no slot holds a library
        slots --activate B | slot B holds no library",
    );
    let listed = bench.succeed("slots");
    assert_eq!(listed.trim(), "slot A: empty\n\nslot B: empty");
}

#[test]
fn what_is_wrong_before_the_device_is_asked_is_told_without_it() {
    let bench = Bench::new().with("STYLUS_LINK", "tcp:localhost:1");
    bench.write("bad.lib", b"nothing");
    bench.refuse_each(
        "upload bad.lib | bad.lib:
        upload absent.lib | absent.lib: cannot read
        settings get hard-limt | did you mean 'hard-limit'?
        play --texture silk --motion absent.csv | absent.csv: cannot read",
    );
}

#[cfg(unix)]
#[test]
fn a_monitor_shows_what_the_sensors_see_and_leaves_no_recording_behind() {
    let (stylus, bench) = started();
    stylus.set_hand(Hand {
        acceleration: vec![[32_000, 32_768, 32_768], [33_536, 32_768, 32_768]],
        ..Hand::moving(80.0, 1.5)
    });
    // The first interval of a command may be over before the first block has arrived.
    let watch = ["status", "--watch", "--interval", "0.25"];
    let mut child = bench.spawn(watch.into_iter().chain(["--json"]));
    let mut sights = BufReader::new(child.stdout.take().unwrap())
        .lines()
        .map(|line| json(&line.unwrap()));
    // 768 codes to both sides of the mean, 3.3 V / 65 536 per code, 29.72 m/s² per V.
    let rms = 768.0 * 3.3 / 65_536.0 * 29.72;
    let is_seen = |sight: &Value| (sight["level"]["rms_m_s2"].as_f64().unwrap_or(0.0) - rms).abs() < 1e-3;
    let sight = sights.find(is_seen).unwrap();
    near(sight["level"]["speed_mm_s"].as_f64().unwrap(), 80.0, 1.0);
    near(sight["level"]["force_n"].as_f64().unwrap(), 1.5, 0.01);
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let mut child = bench.spawn(watch);
    let mut said = BufReader::new(child.stdout.take().unwrap()).lines();
    let is_said = |line: &str| line.contains("1.149 m/s² RMS") && line.contains("idle");
    assert!(said.any(|line| is_said(&line.unwrap())));
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let status = bench.json("status --json");
    assert_eq!(status["status"]["record"]["recording"], false);
    // The duration ends an interval that is longer.
    let seen = bench.succeed("status --watch --seconds 0.5 --interval 60 --json");
    assert_eq!(seen.lines().count(), 1, "{seen}");
    let mut child = bench.spawn(["status", "--watch", "--interval", "60"]);
    wait_for("the recording", || stylus.count("stylus/record/start") >= 4);
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let status = bench.json("status --json");
    assert_eq!(status["status"]["record"]["recording"], false);
}
