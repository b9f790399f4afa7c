//! Several commands on one device at once, through the broker that shares its link, and the list of attached devices.

use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread;
use std::time::Duration;

use fake_stylus::library::library;
use fake_stylus::{FakeStylus, Hand};
use serde_json::Value;

use crate::device_links::port;
use crate::support::{Bench, PLAY, holds, interrupt, json, refusal, signal, text, wait_for};

/// A desk with a stylus that has a library. It has a runtime folder of its own, so it shares no broker with other
/// desks.
struct Desk {
    stylus: FakeStylus,
    bench: Bench,
    /// The link's address that commands receive.
    link: String,
}

impl Desk {
    fn new() -> Self {
        let stylus = FakeStylus::start();
        let link = stylus.link();
        Self::with(stylus, link)
    }

    fn with(stylus: FakeStylus, link: String) -> Self {
        let bench = Bench::new();
        let run = bench.path("run");
        fs::create_dir(&run).unwrap();
        let bench = bench
            .with("XDG_RUNTIME_DIR", run.display().to_string())
            .with("STYLUS_LINK", link.as_str());
        let desk = Self {
            stylus,
            bench,
            link,
        };
        desk.bench.write("a.lib", library(1, 20, 1));
        desk.succeed("upload a.lib --activate");
        desk.stylus.take_heard();
        desk
    }

    fn succeed(&self, arguments: &str) -> String {
        self.bench.succeed(arguments)
    }

    fn refuse(&self, arguments: &str) -> String {
        self.bench.refuse(arguments)
    }

    fn spawn(&self, arguments: &str) -> Child {
        self.bench.spawn(arguments.split_whitespace())
    }

    /// Starts a play, and waits for its motions.
    fn play(&self) -> Child {
        // A general option before the command is not taken for it.
        let player = self
            .bench
            .spawn(["-q"].into_iter().chain(PLAY).chain(["--json"]));
        wait_for("motions", || self.stylus.count("stylus/motion/live") >= 20);
        player
    }

    fn wait_for_recording(&self) {
        let begun = || self.stylus.count("stylus/record/start") > 0;
        wait_for("a recording", begun);
    }

    fn is_playing(&self) -> bool {
        let status = json(&self.succeed("status --json"));
        let output = &status["status"]["output"];
        output["activity"].is_object() && status["muted"] == serde_json::json!([])
    }

    /// Process numbers of the brokers that share this desk's links.
    fn brokers(&self) -> Vec<u32> {
        processes(&self.bench.path("run"))
    }

    fn folder(&self) -> PathBuf {
        self.bench.path("run/stylus")
    }

    /// The file in the runtime folder whose name ends with `ending`.
    fn file(&self, ending: &str) -> PathBuf {
        let entries = fs::read_dir(self.folder()).unwrap();
        let mut paths = entries.map(|entry| entry.unwrap().path());
        paths
            .find(|path| path.to_string_lossy().ends_with(ending))
            .unwrap_or_else(|| panic!("no {ending}"))
    }

    fn wait_until_idle(&self) {
        wait_for("the end of the broker", || self.brokers().is_empty());
    }
}

impl Drop for Desk {
    /// Ends the brokers, so that a test leaves no process behind.
    fn drop(&mut self) {
        for broker in self.brokers() {
            signal("TERM", broker);
        }
        if !thread::panicking() {
            self.wait_until_idle();
        }
    }
}

/// Process numbers of the running brokers under this runtime folder.
fn processes(run: &Path) -> Vec<u32> {
    let wanted = format!("XDG_RUNTIME_DIR={}\0", run.display());
    let entries = fs::read_dir("/proc").unwrap().flatten();
    entries
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.parse().ok()?;
            let command = fs::read(entry.path().join("cmdline")).ok()?;
            let environment = fs::read(entry.path().join("environ")).ok()?;
            let is_broker = text(&command).contains("\0share-link\0");
            (is_broker && text(&environment).contains(&wanted)).then_some(number)
        })
        .collect()
}

fn output_of(child: Child) -> (Option<i32>, String, String) {
    let output = child.wait_with_output().unwrap();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// Runs a play, two monitors, a recording, and short commands at once. None of them ends another.
fn all_at_once(desk: &Desk) {
    desk.stylus.set_hand(Hand::moving(100.0, 1.0));
    let player = desk.play();
    let monitors = [
        desk.spawn("status --watch --json --seconds 1.5"),
        desk.spawn("status --watch --json --seconds 1.2 --interval 0.3"),
    ];
    // On a busy computer the first block may take longer than the second for which a recording waits by default.
    let strokes = desk.spawn("record strokes.csv --strokes --seconds 1 --json --timeout 5");
    for arguments in ["status", "slots", "settings", "settings get hard-limit"] {
        desk.succeed(arguments);
    }
    for monitor in monitors {
        let (code, out, err) = output_of(monitor);
        assert_eq!(code, Some(0), "{out}\n{err}");
        let lines: Vec<Value> = out.lines().map(json).collect();
        assert!(lines.len() >= 3, "{out}");
        let speed = lines.last().unwrap()["level"]["speed_mm_s"]
            .as_f64()
            .unwrap();
        assert!((speed - 100.0).abs() < 5.0, "{out}");
    }
    let (code, out, err) = output_of(strokes);
    assert_eq!(code, Some(0), "{out}\n{err}");
    assert_eq!(json(&out)["lost_samples"], 0, "{out}");
    // On a busy computer a motion may arrive late, which mutes the output for a moment.
    wait_for("the play that goes on", || desk.is_playing());
    interrupt(&player);
    let (code, out, err) = output_of(player);
    assert_eq!(code, Some(0), "{out}\n{err}");
    let report = json(&out);
    // On a busy computer some motions may arrive late.
    assert!(report["muted_share"].as_f64().unwrap() < 0.5, "{out}");
    let status = json(&desk.succeed("status --json"));
    assert_eq!(status["status"]["output"]["activity"], "Idle");
    assert_eq!(status["status"]["record"]["recording"], false);
}

#[test]
fn commands_run_at_once_over_a_serial_port_under_any_of_its_names() {
    let stylus = FakeStylus::start();
    let mut port = port::before(stylus.port());
    port.held = None;
    let link = format!("serial:{}", port.name);
    let desk = Desk::with(stylus, link);
    all_at_once(&desk);
    let name = desk.bench.path("by-id");
    std::os::unix::fs::symlink(&port.name, &name).unwrap();
    let other = format!("serial:{}", name.display());
    let output = desk
        .bench
        .command(["status", "--link", &other])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(desk.brokers().len(), 1);
}

#[test]
fn a_second_play_is_refused_with_who_plays_and_a_stop_of_any_terminal_says_who_stopped() {
    let desk = Desk::new();
    let player = desk.play();
    let refused = desk.refuse("play --scene none");
    let who = format!("`stylus play` (process {}) plays, begun ", player.id());
    holds(&refused, &[&who, "stop it with `stylus stop`"]);
    for arguments in [
        "slots --activate",
        "settings set hard-limit 0.4",
        "upload a.lib --activate",
    ] {
        let refused = desk.bench.run(arguments);
        let err = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{arguments}: {err}");
        holds(&err, &[&who]);
    }
    // An upload on its own does not disturb the play, and neither does a command that is killed.
    desk.succeed("upload a.lib");
    let mut monitor = desk.spawn("status --watch");
    desk.wait_for_recording();
    monitor.kill().unwrap();
    monitor.wait().unwrap();
    wait_for("the play that goes on", || desk.is_playing());
    wait_for("the end of the recording", || {
        desk.stylus.count("stylus/record/stop") > 0
    });
    let stopped = desk.succeed("stop");
    holds(&stopped, &["stopped playing"]);
    let (code, _, err) = output_of(player);
    assert_eq!(code, Some(2));
    holds(&err, &["stopped by `stylus stop` (process "]);
}

#[test]
fn a_broker_that_is_killed_leaves_a_stale_socket_that_stops_nobody() {
    let desk = Desk::new();
    desk.stylus
        .fail(|faults| faults.late = Duration::from_millis(4));
    desk.bench.write("b.lib", library(1, 400, 3));
    let upload = desk.spawn("upload b.lib --json");
    let monitor = desk.spawn("status --watch --seconds 60");
    wait_for("chunks", || desk.stylus.count("stylus/upload/chunk") >= 30);
    desk.wait_for_recording();
    let broker = desk.brokers();
    assert_eq!(broker.len(), 1);
    signal("KILL", broker[0]);
    let (code, _, err) = output_of(monitor);
    assert_eq!(code, Some(2));
    holds(&err, &["the process that shared it has ended"]);
    // The upload continues through a new broker, from where it was.
    let (code, out, err) = output_of(upload);
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(json(&out)["retries"], 1, "{out}");
    let now = desk.brokers();
    assert!(now.len() == 1 && now != broker, "{now:?}");
    assert_eq!(desk.stylus.count("stylus/upload/begin"), 2);
}

#[test]
fn of_many_starters_one_broker_remains_and_it_goes_when_nobody_is_left() {
    let desk = Desk::new();
    desk.wait_until_idle();
    assert!(!desk.folder().read_dir().unwrap().flatten().any(|entry| {
        entry
            .path()
            .extension()
            .is_some_and(|ending| ending == "sock")
    }));
    let connections = desk.stylus.connections();
    let commands: Vec<Child> = (0..6).map(|_| desk.spawn("status --json")).collect();
    for command in commands {
        let (code, out, err) = output_of(command);
        assert_eq!(code, Some(0), "{err}");
        json(&out);
    }
    assert_eq!(desk.stylus.connections(), connections + 1);
    assert_eq!(desk.brokers().len(), 1);
    let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(&desk.folder()), 0o700);
    assert_eq!(mode(&desk.file(".sock")), 0o600);
    assert_eq!(mode(&desk.file(".lock")), 0o600);
    desk.wait_until_idle();
}

#[test]
fn a_device_that_is_unplugged_ends_its_commands_and_its_broker() {
    let mut desk = Desk::new();
    let monitor = desk.spawn("status --watch --seconds 60");
    desk.wait_for_recording();
    desk.stylus = FakeStylus::start();
    let (code, _, err) = output_of(monitor);
    assert_eq!(code, Some(2));
    holds(&err, &["the link was lost: "]);
    desk.wait_until_idle();
    holds(&desk.refuse("status"), &["nothing listens there"]);
    desk.wait_until_idle();
}

#[test]
fn a_broker_of_another_version_is_named_with_its_clients_and_one_that_hangs_is_named_too() {
    let desk = Desk::new();
    desk.wait_until_idle();
    let lock = desk.file(".lock");
    let other = File::options().write(true).open(&lock).unwrap();
    other.lock().unwrap();
    fs::write(&lock, "`stylus play` (process 1)").unwrap();
    let refused = desk.refuse("status");
    let words = "another version of stylus shares it with `stylus play` (process 1)";
    holds(&refused, &[words]);
    holds(&refused, &["--no-broker"]);
    drop(other);
    // The broker leaves a socket behind, and nothing answers on it any more.
    desk.succeed("status");
    let socket = desk.file(".sock");
    desk.wait_until_idle();
    let silent = UnixListener::bind(&socket).unwrap();
    holds(&desk.refuse("status"), &["does not answer: end it"]);
    drop(silent);
    desk.succeed("status");
}

#[test]
fn without_a_broker_a_link_is_opened_alone_unless_others_use_it() {
    let desk = Desk::new();
    let connections = desk.stylus.connections();
    // The command waits for the end of the upload's broker.
    desk.succeed("status --no-broker");
    desk.wait_until_idle();
    assert_eq!(desk.stylus.connections(), connections + 1);
    let player = desk.play();
    let refused = desk.refuse("status --no-broker");
    let who = format!("in use by `stylus play` (process {})", player.id());
    holds(&refused, &[&who]);
    wait_for("the play that goes on", || desk.is_playing());
    interrupt(&player);
    assert_eq!(output_of(player).0, Some(0));
}

#[test]
fn a_monitor_that_reads_too_slowly_loses_its_own_blocks_alone() {
    let desk = Desk::new();
    let slow = desk.spawn("status --watch --seconds 4.5");
    let quick = desk.spawn("record strokes.csv --strokes --seconds 5.5 --json");
    desk.wait_for_recording();
    thread::sleep(Duration::from_millis(500));
    signal("STOP", slow.id());
    thread::sleep(Duration::from_secs(5));
    signal("CONT", slow.id());
    let (code, out, err) = output_of(quick);
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(json(&out)["lost_samples"], 0, "{out}");
    let (code, out, err) = output_of(slow);
    assert_eq!(code, Some(0), "{err}");
    let last = out.lines().last().unwrap();
    let lost = last
        .split(", ")
        .find_map(|part| part.strip_suffix(" on the link"));
    assert!(
        lost.is_some_and(|lost| lost.parse::<u32>().unwrap() > 0),
        "{last}"
    );
}

/// Announces a virtual stylus in the desk's folder, like a running one, until the returned file is dropped.
fn announce(desk: &Desk, name: &str, links: &[&str]) -> File {
    let path = desk.folder().join(format!("virtual-{name}"));
    let mut file = File::create(path).unwrap();
    file.lock().unwrap();
    // The first line is the virtual time.
    writeln!(file, "0").unwrap();
    for link in links {
        writeln!(file, "{link}").unwrap();
    }
    file
}

#[test]
fn what_is_attached_is_listed_and_the_only_one_is_used() {
    let desk = Desk::new();
    let run = |arguments: &[&str]| {
        let mut command = desk.bench.command(arguments.iter().copied());
        command.env_remove("STYLUS_LINK").output().unwrap()
    };
    let none = run(&["status"]);
    let message = refusal(&none, "status");
    holds(&message, &["no stylus is attached: plug one in"]);
    let listed = run(&["devices"]);
    assert_eq!(listed.status.code(), Some(0));
    assert_eq!(text(&listed.stdout), "");

    let _one = announce(&desk, "1-0", &[&desk.link, "usb-virtual:127.0.0.1:1"]);
    let listed = json(&text(&run(&["devices", "--json"]).stdout));
    let rows = listed.as_array().unwrap();
    assert_eq!(rows.len(), 2, "{listed}");
    assert_eq!(rows[0]["link"], desk.link.as_str());
    assert_eq!(rows[0]["kind"], "virtual");
    assert_eq!(rows[0]["serial_number"], "0123456789ABCDEF01234567");
    assert_eq!(rows[0]["state"], "answers");
    assert!(rows[0]["firmware"].is_string());
    assert!(
        rows[1]["state"]
            .as_str()
            .unwrap()
            .contains("nothing listens there"),
        "{listed}"
    );
    let message = text(&run(&["devices"]).stdout);
    holds(&message, &["0123456789ABCDEF01234567", "--link"]);
    let status = run(&["status"]);
    assert!(status.status.success());
    let note = format!("note: {}: the only stylus found\n", desk.link);
    assert_eq!(text(&status.stderr), note);

    let other = FakeStylus::start();
    let two = announce(&desk, "2-0", &[&other.link()]);
    let message = refusal(&run(&["status"]), "status");
    let both = format!(
        "2 styluses are attached: name one, --link {} or --link {}",
        desk.link,
        other.link()
    );
    holds(&message, &[&both]);
    // A virtual stylus that was killed no longer locks its file.
    drop(two);
    assert!(run(&["status"]).status.success());
}

#[test]
fn a_play_whose_motions_do_not_arrive_or_that_is_muted_throughout_fails_with_the_reason() {
    let desk = Desk::new();
    let mut command =
        desk.bench
            .command(PLAY.into_iter().chain(["--seconds", "3", "--timeout", "5"]));
    command.arg("--json");
    desk.stylus
        .fail(|faults| faults.late = Duration::from_millis(900));
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let (report, err) = (json(&text(&output.stdout)), text(&output.stderr));
    let due = report["motions"].as_u64().unwrap() + report["skipped"].as_u64().unwrap();
    let words = format!("only {} of {due} motions could be sent", report["motions"]);
    holds(&err, &[&words, "at least 60"]);
    assert!(
        report["failure"].as_str().unwrap().contains(&words),
        "{report}"
    );

    desk.stylus.fail(|_| ());
    desk.stylus.set_hand(Hand {
        is_open: true,
        ..Hand::default()
    });
    let mut command = desk
        .bench
        .command(["play", "--texture", "texture 0", "--seconds", "1.5"]);
    let output = command.output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    holds(
        &err,
        &[
            "the output was muted throughout (",
            "force sensor at its rail",
        ],
    );
    assert!(
        text(&output.stdout).contains("muted 100 % of the time"),
        "{output:?}"
    );
}

#[test]
fn a_play_shows_speed_force_level_mutes_and_missed_ticks_while_it_lasts() {
    let desk = Desk::new();
    desk.stylus.set_hand(Hand {
        acceleration: vec![[32_768; 3], [34_000; 3]],
        ..Hand::moving(80.0, 0.7)
    });
    for (arguments, speed, force) in [
        (
            &["--speed", "120", "--force", "0.5"][..],
            "120.0 mm/s",
            "0.50 N",
        ),
        (&[][..], "80.0 mm/s", "0.70 N"),
    ] {
        let play = || {
            let mut command =
                desk.bench
                    .command(["play", "--texture", "texture 0", "--seconds", "2.5"]);
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
