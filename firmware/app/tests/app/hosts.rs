//! Two hosts, one on each link: the lease of the host that plays, and changes of settings in two steps.

use fake_stylus::device::{COIL, MOTION, SteppedStylus, change, play_request};
use fake_stylus::flash::SimulatedFlash;
use fake_stylus::hardware::Hardware;
use fake_stylus::library::library;
use fake_stylus::requests::{Requests, frame};
use model_format::link::{
    KeepAliveTopic, LINK_LOST_AFTER_MS, LOCKED, LinkId, MAX_CHUNK_BYTES, MotionEndpoint, MotionRefused, MotionSource,
    PROPOSAL_VALID_MS, PlayEndpoint, PlayError, PlayRequest, ProposalToken, Setting, Settings, SettingsChange,
    SettingsError, SettingsProposal, SettingsProposeEndpoint, Status, StatusEndpoint, StopEndpoint, UploadChunk,
    UploadChunkEndpoint,
};
use postcard_rpc::Endpoint;
use proptest::prelude::*;
use stylus_app::TICKS_PER_MS;
use stylus_app::control::Device;
use stylus_app::safety::Config;

use crate::budget;

/// Time from the last renewal to silence, ms: the lease and the longest ramp.
const SILENT_WITHIN_MS: u32 = 100;

const LINKS: [LinkId; 2] = [LinkId::Usb, LinkId::Serial];

/// A stylus whose coil is set, with an active library, and its dispatcher.
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

    /// Plays with the motion of the device's own sensors, so that silence can only come from the lease.
    fn play(&self, link: LinkId) -> Result<(), PlayError> {
        let request = PlayRequest {
            motion: MotionSource::Sensors,
            ..play_request("texture 0")
        };
        self.requests.ask::<PlayEndpoint>(link, &request).map(drop)
    }

    fn is_stopped(&self, link: LinkId) -> bool {
        self.requests.ask::<StopEndpoint>(link, &()).is_ok()
    }

    fn moves(&self, link: LinkId) -> Result<MotionSource, MotionRefused> {
        self.requests.ask::<MotionEndpoint>(link, &MOTION)
    }

    fn status(&self, link: LinkId) -> Status {
        self.requests.ask::<StatusEndpoint>(link, &())
    }

    fn keep_alive(&self, link: LinkId) {
        self.requests.publish::<KeepAliveTopic>(link, &());
    }

    fn propose(&self, link: LinkId, change: &SettingsChange) -> Result<SettingsProposal, SettingsError> {
        (self.requests).ask::<SettingsProposeEndpoint>(link, change)
    }

    fn proposes_reset(&self, link: LinkId) -> SettingsProposal {
        self.propose(link, &SettingsChange::Reset).expect("it rests")
    }

    fn apply(&mut self, link: LinkId, token: ProposalToken) -> Result<Settings, SettingsError> {
        (self.stylus).request(async |storage, stage| storage.settings_apply(stage, link, token).await)
    }

    fn settings(&self) -> Settings {
        self.stylus.control.borrow().settings()
    }

    fn proposal(&self) -> Option<SettingsProposal> {
        self.stylus.status().proposal
    }
}

fn change_of(values: &[(Setting, f32)]) -> SettingsChange {
    let changes: Vec<_> = values.iter().map(|&(of, value)| change(of, value)).collect();
    SettingsChange::of(&changes).expect("there is room for seven")
}

#[test]
fn a_proposal_ends_with_its_time() {
    let usb = LinkId::Usb;
    let mut stylus = Stylus::new();
    assert_eq!(stylus.proposal(), None, "none at the start");

    let first = stylus.proposes_reset(usb);
    stylus.stylus.run(PROPOSAL_VALID_MS - 1);
    let remaining_ms = stylus.proposal().map(|proposal| proposal.remaining_ms);
    assert_eq!(remaining_ms, Some(1));
    stylus.stylus.run(1);
    assert_eq!(stylus.proposal(), None);
    assert_eq!(stylus.apply(usb, first.token), Err(SettingsError::NoProposal));
}

#[test]
fn the_users_word_is_wanted_for_what_loosens_and_for_first_values_alone() {
    let stylus = Stylus::new();
    let loosens = |setting, value| {
        let proposal = stylus.propose(LinkId::Usb, &change_of(&[(setting, value)]));
        !proposal.expect("it rests").loosens.is_empty()
    };
    for (setting, tighter, looser) in [
        (Setting::HardLimit, 0.1, 0.6),
        (Setting::PowerLimit, 0.05, 0.2),
        (Setting::AmplifierGain, 2.0, 0.5),
        (Setting::CoilResistance, 4.0, 16.0),
        (Setting::SoftStart, 300.0, 100.0),
    ] {
        assert!(!loosens(setting, tighter) && loosens(setting, looser));
        assert!(!loosens(setting, stylus.settings().get(setting)));
    }
    assert!(!loosens(Setting::ForceZero, 12_345.0));
    let first = change_of(&[(Setting::PowerLimit, 0.01)]);
    let unset = SteppedStylus::boot();
    let proposal = unset.control.borrow_mut().propose(LinkId::Usb, first);
    let loosens = proposal.expect("it rests").loosens;
    assert!(loosens.contains(Setting::PowerLimit));
    assert_eq!(stylus.proposes_reset(LinkId::Usb).loosens, LOCKED);
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
    Propose(usize, f32),
    Apply(usize, usize),
}

fn any_step() -> impl Strategy<Value = Step> {
    let link = 0..2usize;
    prop_oneof![
        2 => link.clone().prop_map(Step::Play),
        1 => link.clone().prop_map(Step::Stop),
        2 => link.clone().prop_map(Step::Motion),
        6 => link.clone().prop_map(Step::KeepAlive),
        4 => link.clone().prop_map(Step::Status),
        6 => (1u32..40).prop_map(Step::Wait),
        3 => (link.clone(), 0.05f32..1.4).prop_map(|(link, value)| Step::Propose(link, value)),
        4 => (link, 0..3usize).prop_map(|(link, back)| Step::Apply(link, back)),
    ]
}

/// What two hosts may expect. The holder is the last link whose request to play was accepted, until anybody stops. A
/// value is set only by a proposal of the same link that nothing has ended since.
struct Model {
    holder: Option<usize>,
    renewed_ms: u32,
    now_ms: u32,
    made: Vec<ProposalToken>,
    waiting: Option<(usize, f32, ProposalToken)>,
    limit: f32,
}

impl Model {
    /// Takes a step with the stylus and in the model, and compares the two.
    fn step(&mut self, stylus: &mut Stylus, step: Step) -> Result<(), TestCaseError> {
        match step {
            Step::Play(link) => {
                let held =
                    self.holder.is_some_and(|by| by != link) && self.now_ms - self.renewed_ms <= LINK_LOST_AFTER_MS;
                prop_assert_eq!(stylus.play(LINKS[link]).is_err(), held);
                if !held {
                    (self.holder, self.waiting) = (Some(link), None);
                    self.renewed(link);
                }
            }
            Step::Stop(link) => {
                prop_assert!(stylus.is_stopped(LINKS[link]) || self.holder.is_none());
                self.holder = None;
            }
            Step::Motion(link) => {
                let moved = stylus.moves(LINKS[link]);
                prop_assert_eq!(moved.is_ok(), self.holder.is_none_or(|by| by == link));
                self.renewed(link);
            }
            Step::KeepAlive(link) => {
                stylus.keep_alive(LINKS[link]);
                self.renewed(link);
            }
            Step::Status(link) => {
                let lease = stylus.status(LINKS[link]).lease;
                prop_assert_eq!(lease.holder, self.holder.map(|link| LINKS[link]));
            }
            Step::Wait(ms) => {
                for _ in 0..ms {
                    stylus.stylus.control.millisecond();
                    self.now_ms += 1;
                    let is_kept = self.now_ms - self.renewed_ms <= SILENT_WITHIN_MS;
                    prop_assert!(is_kept || !stylus.stylus.sounds());
                }
            }
            Step::Propose(link, value) => {
                let change = change_of(&[(Setting::HardLimit, value)]);
                if let Ok(proposal) = stylus.propose(LINKS[link], &change) {
                    self.made.push(proposal.token);
                    self.waiting = Some((link, value, proposal.token));
                }
            }
            Step::Apply(link, back) => self.apply(stylus, link, back)?,
        }
        Ok(())
    }

    /// Notes that `link` renews the lease, if it holds it.
    fn renewed(&mut self, link: usize) {
        if self.holder == Some(link) {
            self.renewed_ms = self.now_ms;
        }
    }

    /// Applies the proposal that was made `back` proposals before the last.
    fn apply(&mut self, stylus: &mut Stylus, link: usize, back: usize) -> Result<(), TestCaseError> {
        let Some(&token) = self.made.iter().rev().nth(back) else {
            return Ok(());
        };
        // The device runs with a host on the serial port until the flash is written.
        let before = stylus.stylus.hardware().now();
        let applied = stylus.apply(LINKS[link], token);
        let took_ms = (stylus.stylus.hardware().now() - before) / u64::from(TICKS_PER_MS);
        self.now_ms += took_ms as u32;
        if took_ms > 0 {
            self.renewed(1);
        }
        let is_of = |(by, _, waits): &mut (usize, f32, ProposalToken)| *by == link && *waits == token;
        let matching = self.waiting.take_if(is_of);
        prop_assert_eq!(applied.is_ok(), matching.is_some());
        self.limit = matching.map_or(self.limit, |(_, value, _)| value);
        Ok(())
    }
}

proptest! {
    #![proptest_config(budget::config(1_000))]

    #[test]
    fn whatever_two_hosts_send_only_whoever_plays_keeps_it_from_silence_and_only_the_last_proposal_is_applied(
        steps in prop::collection::vec(any_step(), 1..120),
    ) {
        let mut stylus = Stylus::new();
        let mut model = Model {
            holder: None,
            renewed_ms: 0,
            now_ms: 0,
            made: Vec::new(),
            waiting: None,
            limit: stylus.settings().hard_limit().0,
        };
        for step in steps {
            model.step(&mut stylus, step)?;
            prop_assert_eq!(stylus.settings().hard_limit().0, model.limit);
        }
    }
}

#[test]
fn a_start_begins_with_the_kept_heat_and_a_later_change_of_settings_never_forgets_it() {
    let mut first = Stylus::new().stylus;
    let hot = Config::new(&first.control.borrow().settings(), 1.0).assumed_heat();
    // No heat was kept, so the coil that was then set is assumed to be as warm as it may be without attenuation.
    let heat = first.hardware().heat();
    assert!(heat <= hot);
    let load = first.status().output.thermal_load_permille;
    assert!((600..750).contains(&load), "{load}");
    let mut kept = Hardware::new();
    kept.kept_heat = Some(heat);
    let mut next = SteppedStylus::boot_from_on(SimulatedFlash::two_slots(), kept);
    next.set_coil();
    let now = next.hardware().heat();
    assert!(now <= heat && now.to_bits() > heat.to_bits() / 10 * 9);
    // A reset of the settings and other settings keep the same heat.
    let before = first.hardware().heat().to_bits();
    first.reset_settings().expect("nothing is played");
    let looser = [COIL[0], COIL[1], change(Setting::PowerLimit, 1.0)];
    first.change_settings(&looser).expect("nothing is played");
    let after = first.hardware().heat().to_bits();
    assert!(after > before / 10 * 9, "{before} {after}");
}

#[test]
fn of_a_change_with_one_bad_value_nothing_is_done() {
    let stylus = Stylus::new();
    let propose = |values: &[(Setting, f32)]| stylus.propose(LinkId::Usb, &change_of(values));
    let good = (Setting::HardLimit, 0.1);
    let bad = propose(&[good, (Setting::PowerLimit, 100.0)]);
    assert!(matches!(bad, Err(SettingsError::OutOfRange { .. })));
    let setting = Setting::HardLimit;
    assert_eq!(propose(&[good, good]), Err(SettingsError::Repeated { setting }));
    assert_eq!(propose(&[]), Err(SettingsError::Nothing));
    assert_eq!(stylus.proposal(), None);
}

#[test]
fn a_chunk_that_is_too_long_counts_as_a_frame_that_could_not_be_decoded_and_as_nothing_else() {
    let Stylus { stylus, requests } = Stylus::new();
    for (length, counted) in [(MAX_CHUNK_BYTES, [1, 0]), (MAX_CHUNK_BYTES + 1, [0, 1])] {
        let before = stylus.hardware().link;
        let data = &[0; MAX_CHUNK_BYTES + 1][..length];
        let chunk = UploadChunk { offset: 0, data };
        let frame = frame(UploadChunkEndpoint::REQ_KEY, 1, &chunk);
        requests.serve(LinkId::Usb, &frame, false);
        let after = stylus.hardware().link;
        let counts = [after.frames - before.frames, after.malformed - before.malformed];
        assert_eq!(counts, counted, "{length} bytes");
    }
}
