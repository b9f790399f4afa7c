//! What `play` shows while it lasts, and when it counts as failed.

use std::time::Duration;

use fake_stylus::library::library;
use fake_stylus::{FakeStylus, Hand};

use crate::support::{Bench, PLAY, attached, holds, json, text};

/// A stylus with an active library, and a folder.
fn ready() -> (FakeStylus, Bench) {
    let (stylus, bench) = attached(FakeStylus::start());
    bench.write("a.lib", library(1, 20, 1));
    bench.succeed("upload a.lib --activate");
    (stylus, bench)
}

#[test]
fn a_play_whose_motions_do_not_arrive_or_that_is_muted_throughout_fails_with_the_reason() {
    let (stylus, bench) = ready();
    let mut command = bench.command(PLAY.into_iter().chain(["--seconds", "3", "--timeout", "5"]));
    command.arg("--json");
    stylus.fail(|faults| faults.late = Duration::from_millis(900));
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let (report, err) = (json(&text(&output.stdout)), text(&output.stderr));
    let due = report["motions"].as_u64().unwrap() + report["skipped"].as_u64().unwrap();
    let words = format!("only {} of {due} motions could be sent", report["motions"]);
    holds(&err, &[&words, "at least 60"]);
    assert!(report["failure"].as_str().unwrap().contains(&words), "{report}");

    stylus.fail(|_| ());
    stylus.set_hand(Hand {
        is_open: true,
        ..Hand::default()
    });
    let mut command = bench.command(["play", "--texture", "texture 0", "--seconds", "1.5"]);
    let output = command.output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    holds(&err, &["the output was muted throughout (", "force sensor at its rail"]);
    assert!(text(&output.stdout).contains("muted 100 % of the time"), "{output:?}");
}

#[test]
fn a_play_shows_speed_force_level_mutes_and_missed_ticks_while_it_lasts() {
    let (stylus, bench) = ready();
    stylus.set_hand(Hand {
        acceleration: vec![[32_768; 3], [34_000; 3]],
        ..Hand::moving(80.0, 0.7)
    });
    for (arguments, speed, force) in [
        (&["--speed", "120", "--force", "0.5"][..], "120.0 mm/s", "0.50 N"),
        (&[][..], "80.0 mm/s", "0.70 N"),
    ] {
        let play = || {
            let mut command = bench.command(["play", "--texture", "texture 0", "--seconds", "2.5"]);
            let output = command.args(arguments).output().unwrap();
            let (out, err) = (text(&output.stdout), text(&output.stderr));
            assert_eq!(output.status.code(), Some(0), "{err}");
            (out, err)
        };
        // On a busy computer a motion may arrive so late that the stylus is muted meanwhile, but not in every attempt.
        let stopped = " 0 mutes, 0 missed ticks; at the accelerometer";
        let (out, err) = (0..8)
            .map(|_| play())
            .find(|(out, _)| out.contains(stopped))
            .unwrap_or_else(play);
        let shown = err.lines().any(|line| {
            let playing = "; playing; 0 mutes, 0 missed ticks";
            let words = [speed, force, "accelerometer ", playing];
            words.iter().all(|words| line.contains(words))
        });
        assert!(shown, "{err}");
        holds(&out, &[stopped]);
    }
}
