//! The lease of whoever plays, with two hosts: one on each link.

use std::collections::VecDeque;

use fake_stylus::device::SteppedStylus;
use fake_stylus::library::library;
use fake_stylus::requests::Requests;
use model_format::link::{
    Activity, KEEP_ALIVE_MS, KeepAliveTopic, LINK_LOST_AFTER_MS, LinkId, MotionEndpoint,
    MotionRefused, MotionSample, MotionSource, MotionTopic, MuteReason, PlayEndpoint, PlayError,
    PlayRequest, Selection, StatusEndpoint, StopEndpoint,
};
use model_format::{MillimetresPerSecond, Newton};
use proptest::prelude::*;

use crate::budget;

/// Time from the last renewal to silence, ms: the lease and the longest ramp.
const SILENT_WITHIN_MS: u32 = 100;

const LINKS: [LinkId; 2] = [LinkId::Usb, LinkId::Serial];

/// A stylus with an active library, and its dispatcher.
struct Stylus {
    stylus: SteppedStylus,
    requests: Requests,
}

impl Stylus {
    fn new() -> Self {
        let stylus = SteppedStylus::ready(&library(1, 20, 1));
        let requests = Requests::new(stylus.control.clone());
        Self { stylus, requests }
    }

    fn play(&self, link: LinkId) -> Result<(), PlayError> {
        self.requests
            .ask::<PlayEndpoint>(link, &request())
            .map(|_| ())
    }

    /// Runs for `ms` milliseconds; `link` keeps its lease alive meanwhile.
    fn run_kept(&self, link: LinkId, ms: u32) {
        for now in 0..ms {
            if now % KEEP_ALIVE_MS == 0 {
                self.requests.publish::<KeepAliveTopic>(link, &());
            }
            self.stylus.control.millisecond();
        }
    }
}

/// A play along the device's own sensors, so that silence can only come from the lease.
fn request() -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture("texture 0".try_into().expect("short")),
        gain: 1.0,
        motion: MotionSource::Sensors,
        seed: 7,
    }
}

fn motion() -> MotionSample {
    MotionSample {
        speed: MillimetresPerSecond(100.0),
        force: Newton(1.0),
        position_mm: None,
        contact: None,
    }
}

#[test]
fn a_play_whose_program_died_is_silent_in_time_whatever_else_is_asked_on_either_link() {
    for (player, other) in [(0, 1), (1, 0)] {
        let (player, other) = (LINKS[player], LINKS[other]);
        // The other host polls, drives and keeps alive; a next program on the player's own link polls.
        for (link, drives) in [(other, false), (other, true), (player, false)] {
            let stylus = Stylus::new();
            stylus.play(player).expect("it is there");
            stylus.run_kept(player, 300);
            assert!(stylus.stylus.sounds());
            let mut silent_after = 0;
            while stylus.stylus.sounds() {
                if silent_after % 10 == 0 {
                    stylus.requests.ask::<StatusEndpoint>(link, &());
                    if drives {
                        stylus.requests.publish::<KeepAliveTopic>(link, &());
                        stylus.requests.publish::<MotionTopic>(link, &motion());
                    }
                }
                stylus.stylus.control.millisecond();
                silent_after += 1;
                assert!(silent_after <= SILENT_WITHIN_MS, "it sounds on");
            }
            assert!(silent_after > LINK_LOST_AFTER_MS - KEEP_ALIVE_MS);
            let status = stylus.requests.ask::<StatusEndpoint>(link, &());
            assert!(status.output.mute.contains(MuteReason::LinkLost));
            assert_eq!(
                (status.lease.holder, status.lease.is_alive),
                (Some(player), false)
            );
            // It comes back with whoever plays.
            stylus.run_kept(player, 300);
            assert!(stylus.stylus.sounds());
        }
    }
}

#[test]
fn while_one_link_plays_the_other_may_stop_it_and_may_neither_play_nor_move() {
    let stylus = Stylus::new();
    let [usb, serial] = LINKS;
    assert_eq!(
        stylus
            .requests
            .ask::<StatusEndpoint>(serial, &())
            .lease
            .holder,
        None
    );
    // Without a play, anybody moves.
    assert!(
        stylus
            .requests
            .ask::<MotionEndpoint>(serial, &motion())
            .is_ok()
    );
    stylus.play(usb).expect("it is there");
    stylus.run_kept(usb, 100);
    assert_eq!(stylus.play(serial), Err(PlayError::Held { by: usb }));
    assert_eq!(
        stylus.requests.ask::<MotionEndpoint>(serial, &motion()),
        Err(MotionRefused::Held { by: usb })
    );
    assert!(
        stylus
            .requests
            .ask::<MotionEndpoint>(usb, &motion())
            .is_ok()
    );
    let lease = stylus.requests.ask::<StatusEndpoint>(serial, &()).lease;
    assert_eq!(
        (lease.holder, lease.is_alive, lease.refused),
        (Some(usb), true, 2)
    );
    stylus.run_kept(usb, 300);
    assert!(stylus.stylus.sounds());
    assert!(stylus.requests.ask::<StopEndpoint>(serial, &()).is_ok());
    stylus.run_kept(usb, 100);
    assert!(!stylus.stylus.sounds());
    let status = stylus.requests.ask::<StatusEndpoint>(serial, &());
    assert_eq!(
        (status.output.activity, status.lease.holder),
        (Activity::Idle, None)
    );
    // The one that stopped it may play now, and the lease is its own.
    stylus.play(serial).expect("nobody plays");
    assert_eq!(stylus.play(usb), Err(PlayError::Held { by: serial }));
}

#[test]
fn a_lease_that_has_lapsed_is_taken_over_by_a_play_of_the_other_link() {
    let stylus = Stylus::new();
    let [usb, serial] = LINKS;
    stylus.play(usb).expect("it is there");
    stylus.run_kept(usb, 300);
    stylus.requests.publish::<KeepAliveTopic>(usb, &());
    for _ in 0..=LINK_LOST_AFTER_MS {
        assert!(matches!(stylus.play(serial), Err(PlayError::Held { .. })));
        stylus.stylus.control.millisecond();
    }
    stylus.play(serial).expect("the lease has lapsed");
    stylus.run_kept(serial, 300);
    assert!(stylus.stylus.sounds());
    // The one before does not keep it alive any more.
    stylus.run_kept(usb, SILENT_WITHIN_MS);
    assert!(!stylus.stylus.sounds());
}

/// Act of a host.
#[derive(Clone, Copy, Debug)]
enum Step {
    Play(usize),
    Stop(usize),
    Motion(usize),
    KeepAlive(usize),
    Status(usize),
    Wait(u32),
}

fn any_step() -> impl Strategy<Value = Step> {
    let link = 0..2usize;
    prop_oneof![
        2 => link.clone().prop_map(Step::Play),
        1 => link.clone().prop_map(Step::Stop),
        2 => link.clone().prop_map(Step::Motion),
        6 => link.clone().prop_map(Step::KeepAlive),
        6 => link.prop_map(Step::Status),
        6 => (1u32..40).prop_map(Step::Wait),
    ]
}

proptest! {
    #![proptest_config(budget::config(500))]

    /// Model: the holder is the last link whose play was accepted, until anybody stops it.
    #[test]
    fn whatever_two_hosts_send_only_the_frames_of_whoever_plays_keep_it_from_silence(
        steps in prop::collection::vec(any_step(), 1..120),
    ) {
        let stylus = Stylus::new();
        let (mut holder, mut renewed_ms, mut now_ms) = (None, 0u32, 0u32);
        let mut recent: VecDeque<Step> = VecDeque::new();
        for step in steps {
            recent.push_back(step);
            match step {
                Step::Play(link) => {
                    let held = holder.is_some_and(|by| by != link) && now_ms - renewed_ms <= LINK_LOST_AFTER_MS;
                    let played = stylus.play(LINKS[link]);
                    prop_assert_eq!(played.is_err(), held, "{:?}", recent);
                    if !held {
                        (holder, renewed_ms) = (Some(link), now_ms);
                    }
                }
                Step::Stop(link) => {
                    let stopped = stylus.requests.ask::<StopEndpoint>(LINKS[link], &());
                    prop_assert!(stopped.is_ok() || holder.is_none());
                    holder = None;
                }
                Step::Motion(link) => {
                    let moved = stylus.requests.ask::<MotionEndpoint>(LINKS[link], &motion());
                    prop_assert_eq!(moved.is_ok(), holder.is_none_or(|by| by == link));
                    renewed_ms = if holder == Some(link) { now_ms } else { renewed_ms };
                }
                Step::KeepAlive(link) => {
                    stylus.requests.publish::<KeepAliveTopic>(LINKS[link], &());
                    renewed_ms = if holder == Some(link) { now_ms } else { renewed_ms };
                }
                Step::Status(link) => {
                    let lease = stylus.requests.ask::<StatusEndpoint>(LINKS[link], &()).lease;
                    prop_assert_eq!(lease.holder, holder.map(|link| LINKS[link]));
                }
                Step::Wait(ms) => {
                    for _ in 0..ms {
                        stylus.stylus.control.millisecond();
                        now_ms += 1;
                        if now_ms - renewed_ms > SILENT_WITHIN_MS {
                            prop_assert!(!stylus.stylus.sounds(), "{:?}", recent);
                        }
                    }
                }
            }
        }
    }
}
