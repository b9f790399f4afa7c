//! Changes of settings in two steps: what one frame, another host, a late one or a play may not do.

use fake_stylus::device::SteppedStylus;
use fake_stylus::hardware::Hardware;
use fake_stylus::library::library;
use model_format::link::{
    LOCKED, LinkId, MotionSource, PROPOSAL_VALID_MS, PlayRequest, ProposalToken, Selection,
    Setting, SettingChange, SettingSet, Settings, SettingsChange, SettingsError, SettingsProposal,
};
use proptest::prelude::*;
use stylus_app::safety::Config;

use crate::budget;

const LINKS: [LinkId; 2] = [LinkId::Usb, LinkId::Serial];

fn change(setting: Setting, value: f32) -> SettingChange {
    SettingChange { setting, value }
}

/// The seven settings by which a host would switch protection off.
fn all_told_away() -> SettingsChange {
    let looser = [
        change(Setting::AmplifierGain, 0.01),
        change(Setting::CoilResistance, 1000.0),
        change(Setting::PowerLimit, 1.0),
        change(Setting::ThermalTimeConstant, 60.0),
        change(Setting::HardLimit, 1.45),
        change(Setting::OutputGain, 1.0),
        change(Setting::SlewLimit, 16.0),
    ];
    SettingsChange::of(&looser).expect("there is room for seven")
}

fn propose(
    stylus: &SteppedStylus,
    link: LinkId,
    change: SettingsChange,
) -> Result<SettingsProposal, SettingsError> {
    stylus.control.borrow_mut().propose(link, change)
}

fn apply(
    stylus: &mut SteppedStylus,
    link: LinkId,
    token: ProposalToken,
) -> Result<Settings, SettingsError> {
    stylus.request(async |storage, stage| storage.settings_apply(stage, link, token).await)
}

fn settings(stylus: &SteppedStylus) -> Settings {
    stylus.control.borrow().settings()
}

/// A stylus whose coil is set, with an active library.
fn stylus() -> SteppedStylus {
    SteppedStylus::ready(&library(1, 20, 1))
}

fn play() -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture("texture 0".try_into().expect("short")),
        gain: 1.0,
        motion: MotionSource::Host,
        seed: 7,
    }
}

#[test]
fn no_single_frame_changes_a_setting_and_the_second_one_changes_all_of_them() {
    let mut stylus = stylus();
    let before = settings(&stylus);
    let proposal = propose(&stylus, LinkId::Usb, all_told_away()).expect("nothing is played");
    assert_eq!(settings(&stylus), before);
    let shown = stylus.control.borrow().status().proposal;
    assert_eq!(shown.as_ref(), Some(&proposal));
    assert_eq!(proposal.loosens, {
        let tight = SettingSet::NONE.with(Setting::SoftStart, true);
        LOCKED.without(tight.with(Setting::MuteRamp, true))
    });
    let set = apply(&mut stylus, LinkId::Usb, proposal.token).expect("it was proposed");
    assert_eq!(all_told_away().applied_to(before), Ok(set));
    // The token counts once.
    let again = apply(&mut stylus, LinkId::Usb, proposal.token);
    assert_eq!(again, Err(SettingsError::NoProposal));
    assert_eq!(stylus.control.borrow().status().proposal, None);
}

#[test]
fn a_proposal_ends_with_its_time_a_play_another_proposal_and_a_restart() {
    let reset = || SettingsChange::Reset;
    let gone = Err(SettingsError::NoProposal);
    let mut stylus = stylus();
    let before = settings(&stylus);

    let proposal = propose(&stylus, LinkId::Usb, reset()).expect("nothing is played");
    stylus.run(PROPOSAL_VALID_MS - 1);
    let shown = stylus.control.borrow().status().proposal;
    assert_eq!(shown.map(|proposal| proposal.remaining_ms), Some(1));
    stylus.run(1);
    assert_eq!(stylus.control.borrow().status().proposal, None);
    assert_eq!(apply(&mut stylus, LinkId::Usb, proposal.token), gone);

    let proposal = propose(&stylus, LinkId::Usb, reset()).expect("nothing is played");
    let played = stylus.control.borrow_mut().play(LinkId::Serial, play());
    assert!(played.is_ok());
    assert_eq!(
        propose(&stylus, LinkId::Serial, reset()),
        Err(SettingsError::Playing)
    );
    stylus.control.borrow_mut().stop().expect("it plays");
    stylus.run(100);
    assert_eq!(apply(&mut stylus, LinkId::Usb, proposal.token), gone);

    let first = propose(&stylus, LinkId::Usb, reset()).expect("nothing is played");
    let other = SettingsChange::of(&[change(Setting::HardLimit, 0.1)]).expect("one");
    let second = propose(&stylus, LinkId::Serial, other).expect("nothing is played");
    assert_ne!(first.token, second.token);
    assert_eq!(apply(&mut stylus, LinkId::Usb, first.token), gone);
    assert_eq!(settings(&stylus), before);
    assert!(apply(&mut stylus, LinkId::Serial, second.token).is_ok());

    // The device proposes nothing at its start.
    assert_eq!(
        SteppedStylus::boot().control.borrow().status().proposal,
        None
    );
}

#[test]
fn what_was_proposed_on_one_link_is_not_applied_on_the_other() {
    let mut stylus = stylus();
    let before = settings(&stylus);
    let [usb, serial] = LINKS;
    let proposal = propose(&stylus, usb, all_told_away()).expect("nothing is played");
    let crossed = apply(&mut stylus, serial, proposal.token);
    assert_eq!(crossed, Err(SettingsError::OtherLink { from: usb }));
    let guessed = ProposalToken(proposal.token.0 ^ 1);
    let wrong = apply(&mut stylus, usb, guessed);
    assert_eq!(wrong, Err(SettingsError::NoProposal));
    assert_eq!(settings(&stylus), before);
    // Neither of the two has ended it.
    assert!(apply(&mut stylus, usb, proposal.token).is_ok());
}

#[test]
fn of_a_change_with_one_bad_value_nothing_is_done() {
    let stylus = stylus();
    let of = |values: &[SettingChange]| SettingsChange::of(values).expect("there is room");
    let good = change(Setting::HardLimit, 0.1);
    let bad = propose(
        &stylus,
        LinkId::Usb,
        of(&[good, change(Setting::PowerLimit, 100.0)]),
    );
    assert!(matches!(bad, Err(SettingsError::OutOfRange { .. })));
    let twice = propose(&stylus, LinkId::Usb, of(&[good, good]));
    let setting = Setting::HardLimit;
    assert_eq!(twice, Err(SettingsError::Repeated { setting }));
    let nothing = propose(&stylus, LinkId::Usb, of(&[]));
    assert_eq!(nothing, Err(SettingsError::Nothing));
    assert_eq!(stylus.control.borrow().status().proposal, None);
}

#[test]
fn the_users_word_is_wanted_for_what_loosens_and_for_first_values_alone() {
    let stylus = stylus();
    let loosens = |setting, value| {
        let change = SettingsChange::of(&[change(setting, value)]).expect("one");
        let proposal = propose(&stylus, LinkId::Usb, change).expect("nothing is played");
        !proposal.loosens.is_empty()
    };
    for (setting, tighter, looser) in [
        (Setting::HardLimit, 0.1, 0.6),
        (Setting::PowerLimit, 0.05, 0.2),
        (Setting::AmplifierGain, 2.0, 0.5),
        (Setting::CoilResistance, 4.0, 16.0),
        (Setting::SoftStart, 300.0, 100.0),
    ] {
        assert!(!loosens(setting, tighter) && loosens(setting, looser));
        assert!(!loosens(setting, settings(&stylus).get(setting)));
    }
    assert!(!loosens(Setting::ForceZero, 12_345.0));
    let unset = SteppedStylus::boot();
    let first = SettingsChange::of(&[change(Setting::PowerLimit, 0.01)]).expect("one");
    let proposal = propose(&unset, LinkId::Usb, first).expect("nothing is played");
    assert!(proposal.loosens.contains(Setting::PowerLimit));
    let reset = propose(&stylus, LinkId::Usb, SettingsChange::Reset).expect("nothing is played");
    assert_eq!(reset.loosens, LOCKED);
}

/// Act of a host.
#[derive(Clone, Debug)]
enum Step {
    Propose(usize, f32),
    Apply(usize, usize),
    Play(usize),
    Stop,
    Wait(u32),
}

proptest! {
    #![proptest_config(budget::config(500))]

    /// Model: a value is set only by a proposal of the same link that nothing has ended since.
    #[test]
    fn whatever_two_hosts_send_only_the_last_proposal_is_applied_and_by_its_own_link(
        steps in prop::collection::vec(prop_oneof![
            4 => (0..2usize, 0.05f32..1.4).prop_map(|(link, value)| Step::Propose(link, value)),
            6 => (0..2usize, 0..3usize).prop_map(|(link, back)| Step::Apply(link, back)),
            1 => (0..2usize).prop_map(Step::Play),
            2 => Just(Step::Stop),
            2 => (1u32..30).prop_map(Step::Wait),
        ], 1..60),
    ) {
        let mut stylus = stylus();
        let mut made: Vec<ProposalToken> = Vec::new();
        let mut waiting: Option<(usize, f32, ProposalToken)> = None;
        let mut expected = settings(&stylus).hard_limit().0;
        for step in steps {
            match step {
                Step::Propose(link, value) => {
                    let change = SettingsChange::of(&[change(Setting::HardLimit, value)]).expect("one");
                    if let Ok(proposal) = propose(&stylus, LINKS[link], change) {
                        made.push(proposal.token);
                        waiting = Some((link, value, proposal.token));
                    }
                }
                Step::Apply(link, back) => {
                    let Some(&token) = made.iter().rev().nth(back) else { continue };
                    let applied = apply(&mut stylus, LINKS[link], token);
                    let matching = waiting.take_if(|(by, _, waits)| *by == link && *waits == token);
                    prop_assert_eq!(applied.is_ok(), matching.is_some());
                    expected = matching.map_or(expected, |(_, value, _)| value);
                }
                Step::Play(link) => {
                    if stylus.control.borrow_mut().play(LINKS[link], play()).is_ok() {
                        waiting = None;
                    }
                }
                Step::Stop => {
                    let _ = stylus.control.borrow_mut().stop();
                    stylus.run(100);
                }
                Step::Wait(ms) => stylus.run(ms),
            }
            prop_assert_eq!(settings(&stylus).hard_limit().0, expected);
        }
    }
}

#[test]
fn tokens_do_not_repeat() {
    let stylus = stylus();
    let mut tokens: Vec<u32> = (0..10_000)
        .map(|_| {
            propose(&stylus, LinkId::Usb, SettingsChange::Reset)
                .expect("it rests")
                .token
                .0
        })
        .collect();
    tokens.sort_unstable();
    let close = tokens.windows(2).filter(|pair| pair[0] == pair[1]).count();
    // Of ten thousand random words of 32 bits, one pair in a hundred runs is equal.
    assert!(close <= 1, "{close} equal tokens");
}

#[test]
fn a_start_begins_with_the_kept_heat_and_a_later_change_of_settings_never_forgets_it() {
    let mut first = stylus();
    let hot = Config::new(&settings(&first), 1.0).assumed_heat();
    // Nothing was kept: as warm as may be without attenuation, of the coil that was then set.
    assert!(first.control.borrow_mut().device().heat() <= hot);
    let load = first.control.borrow().status().output.thermal_load_permille;
    assert!((600..750).contains(&load), "{load}");
    let heat = first.control.borrow_mut().device().heat();
    let mut kept = Hardware::new();
    kept.kept_heat = Some(heat);
    let mut next = SteppedStylus::boot_on(kept);
    next.set_coil();
    let now = next.control.borrow_mut().device().heat();
    assert!(now <= heat && now.to_bits() > heat.to_bits() / 10 * 9);
    // A reset of the settings and other ones judge the same heat.
    let before = first.control.borrow_mut().device().heat().to_bits();
    first.reset_settings().expect("nothing is played");
    let looser = [
        change(Setting::CoilResistance, 8.0),
        change(Setting::AmplifierGain, 1.0),
        change(Setting::PowerLimit, 1.0),
    ];
    first.change_settings(&looser).expect("nothing is played");
    let after = first.control.borrow_mut().device().heat().to_bits();
    assert!(after > before / 10 * 9, "{before} {after}");
}
