//! Links and devices that fail: commands that recover, and the messages of commands that cannot.

use std::time::Duration;

use crate::support::{Bench, PLAY, holds, interrupt, reported, started, text, wait_for};
use fake_stylus::FakeStylus;
use fake_stylus::flash::Damage;
use fake_stylus::library::library;
use host_tools::link::{Device, LinkError, Timeouts};
use model_format::link::{DeviceInfo, MAX_CHUNK_BYTES};
use serde_json::Value;

/// A stylus, and a folder with a library of about 100 KB.
fn bench() -> (FakeStylus, Bench, Vec<u8>) {
    let (stylus, bench) = started();
    let bytes = library(1, 400, 3);
    bench.write("a.lib", &bytes);
    (stylus, bench, bytes)
}

fn upload(bench: &Bench) -> Value {
    bench.json("upload a.lib --json --activate")
}

#[test]
fn an_upload_goes_on_where_the_link_broke() {
    let (stylus, bench, bytes) = bench();
    stylus.fail(|faults| faults.close_every = Some(50));
    let report = upload(&bench);
    assert_eq!(report["bytes"], bytes.len());
    let retries = report["retries"].as_u64().unwrap() as usize;
    assert!(retries >= 3, "{report}");
    assert_eq!(stylus.connections(), retries + 1);
    // Each break costs at most the chunk whose answer was lost.
    let chunks = bytes.len().div_ceil(MAX_CHUNK_BYTES);
    let sent = stylus.count("stylus/upload/chunk");
    assert!(sent <= chunks + retries, "{sent} of {chunks}");
}

#[test]
fn an_upload_that_was_killed_is_resumed_by_the_next() {
    let (stylus, bench, bytes) = bench();
    // The upload waits for an answer.
    stylus.fail(|faults| faults.holds_after = Some(40));
    let mut first = bench.spawn(["upload", "a.lib"]);
    wait_for("chunks", || stylus.count("stylus/upload/chunk") >= 30);
    first.kill().unwrap();
    first.wait().unwrap();
    stylus.fail(|_| ());
    holds(&bench.succeed("status"), &["receiving into slot"]);
    stylus.take_heard();
    let report = upload(&bench);
    let resumed_from = report["resumed_from"].as_u64().unwrap() as usize;
    assert!(resumed_from >= 29 * MAX_CHUNK_BYTES, "{report}");
    let rest = (bytes.len() - resumed_from).div_ceil(MAX_CHUNK_BYTES);
    assert_eq!(stylus.count("stylus/upload/chunk"), rest);
}

#[test]
fn an_upload_whose_last_answer_was_lost_is_not_begun_again() {
    let (stylus, bench, bytes) = bench();
    let chunks = bytes.len().div_ceil(MAX_CHUNK_BYTES);
    // The requests are the device's description, the begin, the chunks and the commit.
    stylus.fail(|faults| faults.close_every = Some(chunks + 3));
    let report = upload(&bench);
    assert_eq!(report["sequence"], 1);
    assert_eq!(report["retries"], 1);
    assert_eq!(stylus.count("stylus/upload/begin"), 1);
    assert_eq!(stylus.count("stylus/upload/commit"), 1);
}

#[test]
fn answers_that_break_on_the_way_and_noise_between_them_do_no_harm() {
    let (stylus, _bench, bytes) = bench();
    stylus.fail(|faults| {
        faults.corrupt_every = Some(150);
        faults.noise = true;
    });
    // Each broken answer is waited for until the timeout. Any other answer that is later costs a retry only.
    let timeouts = Timeouts {
        flash: Duration::from_secs(3),
        ..Timeouts::scaled_to(Duration::from_mins(1))
    };
    let address = stylus.link().parse().unwrap();
    let mut device = Device::connect(&address, timeouts).unwrap();
    let uploaded = host_tools::link::upload::upload(&mut device, &bytes, |_| ()).unwrap();
    assert_eq!(uploaded.library.length as usize, bytes.len());
    assert!(uploaded.retries >= 1, "{uploaded:?}");
}

#[test]
fn a_device_whose_flash_is_busy_is_asked_until_it_is_free() {
    let (stylus, bench, _) = bench();
    stylus.fail(|faults| faults.busy_from = Some("stylus/upload/begin"));
    let report = std::thread::scope(|scope| {
        scope.spawn(|| {
            let is_repeated = || stylus.count("stylus/upload/begin") > 2;
            wait_for("the same request", is_repeated);
            stylus.fail(|_| ());
        });
        upload(&bench)
    });
    assert_eq!(report["retries"], 0);
    stylus.fail(|faults| faults.busy_from = Some("stylus/slots"));
    // No answer is waited for until its timeout, because a busy device refuses at once.
    let timeouts = Timeouts {
        flash: Duration::from_secs(1),
        ..Timeouts::scaled_to(Duration::from_mins(1))
    };
    let address = stylus.link().parse().unwrap();
    let device = Device::connect(&address, timeouts).unwrap();
    let refused = device.slots().unwrap_err();
    let words = "the device did not accept the slot list request";
    holds(&refused, &[words]);
}

#[test]
fn an_upload_that_gets_nowhere_ends_with_the_reason() {
    let (stylus, bench, _) = bench();
    stylus.fail(|faults| faults.close_every = Some(2));
    let refused = bench.refuse("upload a.lib");
    holds(&refused, &["the link was lost: the other side closed it"]);
    assert_eq!(stylus.connections(), 5);
}

#[test]
fn a_device_that_says_nothing_is_given_up_in_time() {
    let (stylus, bench, _) = bench();
    stylus.fail(|faults| faults.silent = true);
    let message = bench.refuse("status --timeout 0.3");
    // The remedy is an option that can be typed as it stands.
    let words = "no answer to the identity request within 0.3 s";
    holds(&message, &[words, "--timeout 2"]);
}

#[test]
fn an_answer_that_comes_too_late_is_no_answer_to_what_is_asked_next() {
    let stylus = FakeStylus::start();
    let address = stylus.link().parse().unwrap();
    let timeouts = Timeouts::scaled_to(Duration::from_millis(400));
    let mut connected = None;
    wait_for("the identity", || {
        connected = Device::connect(&address, timeouts).ok();
        connected.is_some()
    });
    let device = connected.unwrap();
    stylus.fail(|faults| faults.holds_after = Some(0));
    let failure = device.status().unwrap_err();
    let LinkError::NoAnswer { request, .. } = &failure else {
        panic!("{failure}")
    };
    assert_eq!(*request, "status");
    stylus.pass(Duration::from_millis(100));
    let after = stylus.time();
    stylus.fail(|_| ());
    // Answers from now on come after the one that is late, which is older and must not be mistaken for one of them.
    let mut asked = 0;
    wait_for("the status", || {
        let Ok(status) = device.status() else {
            return false;
        };
        asked += 1;
        assert!(u128::from(status.uptime_ms) >= after.as_millis() - 1);
        asked == 3
    });
}

/// Changes the description that a device gives of itself.
type Disguise = fn(&mut DeviceInfo);

/// Returns the message that a user of a device with `disguise` receives.
fn said_to(disguise: Disguise, arguments: &str) -> String {
    let (stylus, bench) = started();
    bench.write("a.lib", library(1, 4, 3));
    stylus.fail(|faults| faults.disguise = Some(disguise));
    let message = bench.refuse(arguments);
    // The command has requested only the device's description.
    let heard = stylus.take_heard();
    assert!(heard.iter().all(|heard| heard.path == "stylus/info"));
    message
}

#[test]
fn of_two_versions_the_older_is_named_before_anything_is_asked() {
    const DEVICE: &str = "the device's firmware is the older side: flash it from this version";
    const HOST: &str = "this program is the older side: build it from";
    let [old, new]: [Disguise; 2] = [
        |info| {
            info.schema_hash ^= 1;
            info.firmware_version = "0.0.1".try_into().unwrap();
        },
        |info| {
            info.schema_hash ^= 1;
            info.firmware_version = "99.0.0".try_into().unwrap();
        },
    ];
    let upload = "upload a.lib";
    let cases: [(Disguise, &str, &str); 6] = [
        (|info| info.protocol_version -= 1, "status", DEVICE),
        (|info| info.protocol_version += 1, "status", HOST),
        (old, "play --texture silk", DEVICE),
        (new, "slots", HOST),
        (|info| info.library_format_version -= 1, upload, DEVICE),
        (|info| info.library_format_version += 1, upload, HOST),
    ];
    for (disguise, arguments, words) in cases {
        holds(&said_to(disguise, arguments), &[words]);
    }
    let message = said_to(|info| info.schema_hash ^= 1, "settings");
    holds(&message, &["from one version of the sources"]);
}

#[cfg(unix)]
#[test]
fn playing_over_a_slow_link_leaves_motions_out_instead_of_carrying_them_later_and_later() {
    /// Motions that may be sent before the answer to one of them: two are asked for, and each 16th asks.
    const UNANSWERED: usize = 2 * 16;
    let (stylus, bench, _) = bench();
    upload(&bench);
    let play = bench.spawn(PLAY.into_iter().chain(["--json"]));
    let motions = || stylus.count("stylus/motion/live") + stylus.count("stylus/motion");
    wait_for("motions", || motions() > 0);
    stylus.fail(|faults| faults.holds_after = Some(0));
    stylus.take_heard();
    // While motions wait, keep-alives show the device that the host is present.
    let keep_alives = || stylus.count("stylus/keep-alive");
    wait_for("keep-alives", || keep_alives() >= 10);
    // Those of an answer that was on its way are sent, too.
    assert!(motions() <= 2 * UNANSWERED, "{}", motions());
    let held = motions();
    wait_for("more of them", || keep_alives() >= 20);
    assert_eq!(motions(), held);
    stylus.fail(|_| ());
    // So many that a play with this pause is none that failed.
    wait_for("motions again", || motions() > held + 2_000);
    let readings = stylus.count("stylus/status") + 3;
    wait_for("the status", || stylus.count("stylus/status") >= readings);
    interrupt(&play);
    let output = play.wait_with_output().unwrap();
    let report = reported(&output);
    assert!(report["skipped"].as_u64().unwrap() > 0, "{report}");
    assert!(report["keep_alives"].as_u64().unwrap() >= 20, "{report}");
}

#[test]
fn the_last_library_that_can_be_read_is_replaced_only_where_the_user_asks_for_it() {
    let (stylus, bench) = started();
    for (name, seed) in [("a.lib", 1), ("b.lib", 2), ("c.lib", 3)] {
        bench.write(name, library(1, 4, seed));
    }
    bench.succeed("upload a.lib --activate");
    bench.succeed("upload b.lib");
    // The active library continues to play from RAM, but its slot cannot be read any more.
    stylus.damage(0, Damage::Faulting);
    holds(&bench.refuse("upload c.lib"), &["activate slot B", "--replace-last"]);
    let uploaded = bench.run("upload c.lib --replace-last");
    assert!(uploaded.status.success(), "{uploaded:?}");
    holds(&text(&uploaded.stderr), &["without one"]);
    holds(&bench.succeed("slots --json"), &["\"B\""]);
}
