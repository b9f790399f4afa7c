//! Two programs with one stylus: on one link the second is refused, and over two links both work.

use std::fs::File;
use std::process::{Child, Output};

use fake_stylus::FakeStylus;
use fake_stylus::library::library;
use serde_json::{Value, json};

use crate::device_links::{announce, at_a_desk, port};
use crate::support::{Bench, LONGEST_WAIT_S, PLAY, holds, interrupt, json, text, wait_for};

/// A stylus with a library and two announced links, of which commands use the first.
struct Desk {
    stylus: FakeStylus,
    bench: Bench,
    _announced: File,
}

impl Desk {
    fn new() -> Self {
        let (stylus, bench) = (FakeStylus::start(), at_a_desk());
        let announced = announce(&bench, "1-0", &[&stylus.link(), &stylus.other_link()]);
        let bench = bench
            .with("STYLUS_LINK", stylus.link())
            .with("STYLUS_TIMEOUT", LONGEST_WAIT_S.to_string());
        bench.write("a.lib", library(1, 20, 1));
        bench.succeed("upload a.lib --activate");
        stylus.take_heard();
        Self {
            stylus,
            bench,
            _announced: announced,
        }
    }

    /// Starts a play, and waits for its motions.
    fn play(&self) -> Child {
        // A general option before the command is not taken for it.
        let player = self.bench.spawn(["-q"].into_iter().chain(PLAY).chain(["--json"]));
        self.wait_for_motions();
        player
    }

    fn wait_for_motions(&self) {
        self.stylus.take_heard();
        wait_for("motions", || self.stylus.count("stylus/motion/live") >= 20);
    }

    /// The answer to `stylus status` over the other link.
    fn status(&self) -> Value {
        let status = format!("status --json --link {}", self.stylus.other_link());
        json(&self.bench.succeed(&status))
    }
}

fn ended(child: Child) -> (Output, String) {
    let output = child.wait_with_output().unwrap();
    let told = text(&output.stderr);
    (output, told)
}

#[test]
fn a_second_program_on_a_link_is_refused_with_the_first_ones_name_and_the_first_goes_on() {
    let desk = Desk::new();
    let player = desk.play();
    let connections = desk.stylus.connections();
    let who = format!("in use by `stylus play` (process {})", player.id());
    for second in [
        "status",
        "play --scene none",
        "upload a.lib --activate",
        "record strokes.csv --strokes --seconds 1",
    ] {
        holds(&desk.bench.refuse(second), &[&who, "close that program"]);
    }
    let rows = json(&desk.bench.succeed("devices --json"));
    holds(&rows[0]["state"], &[&who]);
    assert_eq!(rows[1]["link"], desk.stylus.other_link());
    // Only the list of devices has reached the stylus, over its other link.
    assert_eq!(desk.stylus.connections(), connections + 1);
    desk.wait_for_motions();
    interrupt(&player);
    let (output, told) = ended(player);
    assert!(json(&text(&output.stdout))["motions"].is_u64(), "{told}");
}

#[test]
fn the_refusal_names_the_other_link_over_which_a_stop_ends_the_play_of_the_first() {
    let desk = Desk::new();
    let player = desk.play();
    let refused = desk.bench.refuse("stop").replace("\n  ", " ");
    let (_, remedy) = refused.split_once("other link, ").unwrap();
    assert_eq!(remedy.trim(), format!("--link {}", desk.stylus.other_link()));
    let stopped = desk.bench.succeed(&format!("stop {remedy}"));
    holds(&stopped, &["stopped playing"]);
    let (output, told) = ended(player);
    assert_eq!(output.status.code(), Some(2));
    holds(&told, &["stopped over the stylus's other link"]);
}

#[test]
fn a_player_that_is_killed_frees_its_link_and_the_stylus_mutes() {
    let desk = Desk::new();
    let mut player = desk.play();
    player.kill().unwrap();
    player.wait().unwrap();
    wait_for("the mute", || desk.status()["muted"] != json!([]));
    holds(&desk.bench.succeed("stop"), &["stopped playing"]);
}

#[test]
fn a_serial_port_is_refused_to_a_second_program_under_any_of_its_names() {
    let stylus = FakeStylus::start();
    let mut port = port::before(stylus.port());
    port.held = None;
    let bench = at_a_desk().with("STYLUS_TIMEOUT", LONGEST_WAIT_S.to_string());
    let watch = format!("status --watch --link serial:{}", port.name);
    let first = bench.spawn(watch.split_whitespace());
    wait_for("a recording", || stylus.count("stylus/record/start") > 0);
    let name = bench.path("by-id");
    std::os::unix::fs::symlink(&port.name, &name).unwrap();
    let who = format!("in use by `stylus status` (process {})", first.id());
    for name in [&port.name, &name.display().to_string()] {
        let refused = bench.refuse(&format!("status --link serial:{name}"));
        holds(&refused, &[&who, "`stylus devices` lists"]);
    }
    let before = stylus.count("stylus/status");
    wait_for("more of the first", || stylus.count("stylus/status") > before);
    interrupt(&first);
    let (output, told) = ended(first);
    assert!(output.status.success(), "{told}");
}
