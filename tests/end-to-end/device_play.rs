//! What `play` shows while it lasts, and when it counts as failed.

use std::time::Duration;

use fake_stylus::Hand;

use crate::device_commands::ready;
use crate::support::{holds, play_for, text};

#[cfg(unix)]
#[test]
fn a_play_that_is_muted_throughout_fails_with_the_reason() {
    let (stylus, bench) = ready();
    stylus.set_hand(Hand {
        is_open: true,
        ..Hand::default()
    });
    let play = ["play", "--texture", "texture 0"];
    let output = play_for(Duration::from_millis(1_500), &stylus, &bench, play);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    holds(&err, &["the output was muted throughout (", "force sensor at its rail"]);
    assert!(text(&output.stdout).contains("muted 100 % of the time"), "{output:?}");
}

#[cfg(unix)]
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
        let play = ["play", "--texture", "texture 0"]
            .into_iter()
            .chain(arguments.iter().copied());
        let output = play_for(Duration::from_millis(2_500), &stylus, &bench, play);
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{err}");
        let shown = err.lines().any(|line| {
            // How often the output was muted depends on how late this computer was.
            let words = [
                speed,
                force,
                "accelerometer ",
                "; playing; ",
                " mute",
                ", 0 missed ticks",
            ];
            words.iter().all(|words| line.contains(words))
        });
        assert!(shown, "{err}");
        holds(&out, &[" mute", ", 0 missed ticks; at the accelerometer"]);
    }
}
