//! The player against a model of the output: every exchange happens in silence.

use fake_stylus::device::play_request as request;
use model_format::PlayRate;
use model_format::link::{ActivateError, Activity, MuteReason, PlayRequest, StopError};
use proptest::prelude::*;
use stylus_app::player::{Action, Begin, Observed, Player};

const QUIET: Observed = Observed {
    at_rest: true,
    stale: false,
    railed: false,
    link_lost: false,
};
const SOUNDING: Observed = Observed {
    at_rest: false,
    ..QUIET
};

fn playing(name: &str) -> Player {
    let mut player = Player::new();
    player
        .play(request(name), PlayRate::Hz5000)
        .expect("nothing is activated");
    assert_eq!(
        player.poll(QUIET),
        Some(Action::Start(request(name), PlayRate::Hz5000))
    );
    assert!(player.mute().is_empty());
    player
}

#[test]
fn another_texture_takes_over_without_a_mute_and_another_gain_or_rate_after_the_first_has_faded() {
    let mut player = playing("one");
    let slow = PlayRate::Hz5000;
    assert_eq!(player.play(request("two"), slow), Ok(Begin::Switch));
    assert!(player.mute().is_empty());
    let louder = |name| PlayRequest {
        gain: 2.0,
        ..request(name)
    };
    for (first, last, rate) in [
        (louder("one"), louder("two"), slow),
        (request("one"), request("two"), PlayRate::Hz10000),
        (request("two"), request("one"), slow),
    ] {
        assert_eq!(player.play(first, rate), Ok(Begin::AtRest));
        assert!(player.mute().contains(MuteReason::Changing));
        assert_eq!(player.poll(SOUNDING), None);
        assert_eq!(player.activity(), Activity::FadingOut);
        // The request that came last during the fade-out begins.
        assert_eq!(player.play(last.clone(), rate), Ok(Begin::AtRest));
        assert_eq!(player.poll(QUIET), Some(Action::Start(last, rate)));
        assert!(player.mute().is_empty());
    }
}

#[test]
fn a_library_is_exchanged_at_rest_and_nothing_else_happens_meanwhile() {
    let mut player = playing("one");
    assert_eq!(player.begin_activation(), Ok(()));
    assert_eq!(player.poll(SOUNDING), None);
    assert!(!player.may_exchange());
    assert_eq!(player.poll(QUIET), Some(Action::Clear));
    assert!(player.may_exchange());
    assert_eq!(player.begin_activation(), Err(ActivateError::Busy));
    assert!(player.play(request("two"), PlayRate::Hz5000).is_err());
    assert_eq!(player.stop(), Err(StopError::NotPlaying));
    player.end_activation();
    assert!(!player.may_exchange() && player.activity() == Activity::Idle);
    assert!(player.play(request("two"), PlayRate::Hz5000).is_ok());
}

#[test]
fn stale_motion_and_a_lost_link_mute_until_they_are_over() {
    let mut player = playing("one");
    let [mut railed, mut stale, mut link_lost] = [SOUNDING; 3];
    (railed.railed, stale.stale, link_lost.link_lost) = (true, true, true);
    for (observed, reason) in [
        (railed, MuteReason::ForceRail),
        (stale, MuteReason::Stale),
        (link_lost, MuteReason::LinkLost),
    ] {
        for _ in 0..3 {
            player.poll(observed);
            assert_eq!(player.mute().iter().collect::<Vec<_>>(), [reason]);
        }
        player.poll(SOUNDING);
        assert!(player.mute().is_empty());
        assert_eq!(player.mute_counts()[reason as usize], 1, "it began once");
    }
}

#[test]
fn after_a_fault_it_is_mute_for_good() {
    let mut player = playing("one");
    player.not_started();
    for _ in 0..2 {
        player.poll(QUIET);
        assert!(player.mute().contains(MuteReason::Fault));
        let _ = player.play(request("two"), PlayRate::Hz5000);
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Play,
    Stop,
    Begin,
    End,
    Poll { stale: bool, link_lost: bool },
}

proptest! {
    /// The model of the output is a level that rises while it is not mute and falls while it is.
    #[test]
    fn nothing_is_exchanged_while_the_output_sounds(steps in prop::collection::vec(prop_oneof![
        1 => Just(Step::Play), 1 => Just(Step::Stop), 1 => Just(Step::Begin), 1 => Just(Step::End),
        6 => (prop::bool::weighted(0.2), prop::bool::weighted(0.2))
            .prop_map(|(stale, link_lost)| Step::Poll { stale, link_lost }),
    ], 1..200)) {
        let (mut player, mut level) = (Player::new(), 0u32);
        let mut texture_there = false;
        for step in steps {
            match step {
                Step::Play => { let _ = player.play(request("one"), PlayRate::Hz5000); }
                Step::Stop => { let _ = player.stop(); }
                Step::Begin => { let _ = player.begin_activation(); }
                Step::End => {
                    if player.may_exchange() {
                        prop_assert_eq!(level, 0);
                        player.end_activation();
                    }
                }
                Step::Poll { stale, link_lost } => {
                    let action = player.poll(Observed { at_rest: level == 0, stale, link_lost, ..QUIET });
                    if let Some(action) = action {
                        prop_assert_eq!(level, 0, "{:?}", action);
                        texture_there = matches!(action, Action::Start(..));
                    }
                }
            }
            if player.may_exchange() {
                prop_assert!(!player.mute().is_empty() && level == 0);
            }
            // The tick.
            level = if player.mute().is_empty() { (level + 1).min(5) } else { level.saturating_sub(1) };
            prop_assert!(level == 0 || texture_there, "something sounds, so something is played");
        }
    }
}
