//! Probes and responses: the samples that come out, the ends of a probe, and what each request changes.

use fake_stylus::device::{SteppedStylus, change, play_request, response_for};
use fake_stylus::library::{library, texture};
use model_format::link::{
    Activity, LIBRARY_CRC, LINK_LOST_AFTER_MS, LinkId, MAX_PROBE_SAMPLES, PROBE_CHUNK_SAMPLES,
    PlayError, ProbeError, ProbeLoad, ProbeStart, ProbeStarted, ProbeThrough, Response,
    ResponseChange, ResponseError, ResponseState, Sections, Selection, Setting, SettingSet,
    Settings, SettingsError,
};
use model_format::scene::Biquad;
use model_format::{DacCode, Library, OutputSample, PlayRate, encode};
use proptest::prelude::*;
use stylus_app::control::{Device, plan_of};
use stylus_app::safety::{Config, OVERSAMPLING, State};
use stylus_app::{TICKS_PER_MS, UPDATE_INTERVAL_TICKS};
use stylus_kernel::Motion;
use stylus_kernel::scene::cost::BUDGET;
use stylus_kernel::scene::{Equaliser, EqualiserState, Interaction, ScenePlayer};

use crate::budget;

const LINK: LinkId = LinkId::Serial;

fn ready() -> SteppedStylus {
    SteppedStylus::ready(&library(1, 4, 1))
}

/// Loads `period` as a host does, and returns a request to play it `periods` times at 5 kHz.
fn load(stylus: &SteppedStylus, period: &[i16], periods: u16) -> ProbeStart {
    let mut control = stylus.control.borrow_mut();
    for (number, samples) in period.chunks(PROBE_CHUNK_SAMPLES).enumerate() {
        let load = ProbeLoad {
            offset: (number * PROBE_CHUNK_SAMPLES) as u16,
            samples: samples.iter().copied().collect(),
        };
        control.load_probe(LINK, &load).expect("nothing is played");
    }
    let bytes: Vec<u8> = period
        .iter()
        .flat_map(|sample| sample.to_le_bytes())
        .collect();
    ProbeStart {
        rate_hz: 5_000,
        length: period.len() as u16,
        periods,
        crc32: LIBRARY_CRC.checksum(&bytes),
        peak_m_s2: 7.5,
        through: ProbeThrough::Nothing,
    }
}

fn start(stylus: &SteppedStylus, request: &ProbeStart) -> Result<ProbeStarted, ProbeError> {
    stylus.control.borrow_mut().start_probe(LINK, request)
}

fn set(stylus: &mut SteppedStylus, change: ResponseChange) -> Result<ResponseState, ResponseError> {
    stylus.request(async |storage, stage| storage.response_set(stage, LINK, change).await)
}

fn propose(stylus: &SteppedStylus, response: &Response) -> Result<u32, ResponseError> {
    stylus
        .control
        .borrow_mut()
        .propose_response(LINK, *response)
}

/// One tick, with its codes; and the poll that follows every millisecond, of a host that is heard.
fn tick(stylus: &SteppedStylus) -> (u64, bool, [DacCode; OVERSAMPLING]) {
    let mut control = stylus.control.borrow_mut();
    let device = control.device();
    let muted = device.is_muted();
    device.tick();
    let (now, codes) = (device.now(), device.codes);
    if now.is_multiple_of(TICKS_PER_MS.into()) {
        control.keep_alive(LINK);
        control.poll();
        while control.next_block().is_some() {}
    }
    (now, muted, codes)
}

/// The samples of a probe as its request defines them.
fn samples(request: &ProbeStart, period: &[i16]) -> Vec<OutputSample> {
    let step =
        request.peak_m_s2 * (1u32 << OutputSample::FRACTION_BITS) as f32 / f32::from(i16::MAX);
    let one = period
        .iter()
        .map(|&sample| OutputSample((f32::from(sample) * step) as i32));
    std::iter::repeat_n(one, request.periods.into())
        .flatten()
        .collect()
}

/// Checks every code of a probe, from the request to rest, against samples, equaliser and safety stages alone.
fn check_codes(
    stylus: &SteppedStylus,
    request: &ProbeStart,
    period: &[i16],
    settings: &Settings,
    sections: &[Biquad],
) {
    let rate = PlayRate::of(request.rate_hz).expect("it is one");
    let per_tick = rate.samples_per_tick() as usize;
    let started = start(stylus, request).expect("it is playable");
    let samples = samples(request, period);
    let length = samples.len().div_ceil(per_tick) as u64;
    assert_eq!(started.end_tick, started.first_tick + length);
    let config = Config::at_rate(settings, 1.0, rate);
    let (mut safety, mut state) = (
        State::with_heat(stylus.hardware().heat()),
        EqualiserState::new(),
    );
    let equaliser = Equaliser::new(sections);
    let mut peak = 0;
    loop {
        let (now, muted, codes) = tick(stylus);
        let at = |n: usize| {
            let at = (now.checked_sub(started.first_tick)? as usize) * per_tick + n;
            samples.get(at).copied()
        };
        let mut next = |n| {
            let sample = at(n).unwrap_or_default();
            // Without a section there is no stage, which would round.
            if equaliser.is_empty() {
                return sample;
            }
            state.process(&equaliser, sample).0
        };
        let expected = match rate {
            PlayRate::Hz5000 => safety.process(&config, next(0), muted),
            PlayRate::Hz10000 => safety.process_pair(&config, [next(0), next(1)], muted),
        };
        assert_eq!(codes, expected, "tick {now} of {started:?}");
        peak = codes
            .iter()
            .map(|code| code.get().abs_diff(2048))
            .fold(peak, u16::max);
        let activity = stylus.status().output.activity;
        if now < started.end_tick {
            assert_eq!(activity, Activity::Probing);
        } else if activity == Activity::Idle {
            break;
        }
        assert!(now < started.end_tick + 500, "it does not end");
    }
    assert!(peak > 3, "it was not heard");
    assert!(!stylus.sounds() && !stylus.status().lease.is_alive);
}

proptest! {
    #![proptest_config(budget::config(12))]

    /// Bit for bit: whatever the waveform, the rate, the phase of the blocks, and the equaliser.
    #[test]
    fn a_probe_puts_out_its_samples_from_the_tick_it_said_and_ends_by_itself(
        period in prop::collection::vec(-32_767i16..=32_767, 1..MAX_PROBE_SAMPLES),
        periods in 2u16..4, wait in 0..UPDATE_INTERVAL_TICKS, fast: bool,
        through in prop::sample::select(vec![ProbeThrough::Nothing, ProbeThrough::Proposed, ProbeThrough::Stored]),
    ) {
        let mut stylus = ready();
        // So that what a short probe plays is heard at all.
        stylus.change_settings(&[change(Setting::SoftStart, 5.0)]).expect("nothing is played");
        for _ in 0..wait {
            tick(&stylus);
        }
        let response = response_for(&stylus.hardware().settings);
        let id = propose(&stylus, &response).expect("it is valid");
        if through == ProbeThrough::Stored {
            set(&mut stylus, ResponseChange::Store { id }).expect("it was proposed");
        }
        let rate_hz = if fast { 10_000 } else { 5_000 };
        // At least 0.1 s, for the same reason.
        let periods = periods.max((1_000 / period.len()) as u16 + 1);
        let request = ProbeStart { rate_hz, through, ..load(&stylus, &period, periods) };
        let mut settings = stylus.hardware().settings;
        let mut sections = Vec::new();
        if through != ProbeThrough::Nothing {
            settings = settings.with(response.change()).expect("in range");
            sections = response.sections_5khz.biquads().to_vec();
        }
        check_codes(&stylus, &request, &period, &settings, &sections);
        let stored = stylus.control.borrow().response().stored.map(|stored| stored.id);
        prop_assert_eq!(stored, (through == ProbeThrough::Stored).then_some(id));
    }
}

#[test]
fn a_probe_ends_with_a_stop_and_with_a_host_that_is_not_heard_and_may_begin_again() {
    let stylus = ready();
    let period = [20_000i16, -20_000, 10_000, -10_000];
    let request = load(&stylus, &period, 10_000);
    for stops in [true, false] {
        let started = start(&stylus, &request).expect("it is playable");
        while stylus.hardware().now() < started.whole_tick {
            tick(&stylus);
        }
        assert!(stylus.sounds());
        // Nothing else begins, and nothing changes meanwhile.
        assert_eq!(start(&stylus, &request), Err(ProbeError::Playing));
        let other = stylus
            .control
            .borrow_mut()
            .start_probe(LinkId::Usb, &request);
        let held = PlayError::Held { by: LINK };
        assert_eq!(other, Err(ProbeError::Refused(held)));
        let proposed = propose(&stylus, &response_for(&Settings::default()));
        assert_eq!(
            proposed,
            Err(ResponseError::Settings(SettingsError::Playing))
        );
        if stops {
            stylus.control.borrow_mut().stop().expect("it is played");
        }
        // The last keep-alive was of the tick before.
        for _ in 0..LINK_LOST_AFTER_MS + 100 {
            stylus.control.millisecond();
        }
        assert!(!stylus.sounds());
        assert_eq!(stylus.status().output.activity, Activity::Idle);
        assert!(stylus.hardware().now() < started.end_tick);
    }
}

#[test]
fn a_probe_that_cannot_be_played_is_refused_and_says_why() {
    let stylus = ready();
    let request = load(&stylus, &[1, 2, 3], 4);
    let with = |change: fn(&mut ProbeStart)| {
        let mut request = request;
        change(&mut request);
        start(&stylus, &request).expect_err("it is refused")
    };
    assert_eq!(
        with(|r| r.rate_hz = 8_000),
        ProbeError::Rate { rate_hz: 8_000 }
    );
    let length = |length, periods| ProbeError::Length { length, periods };
    assert_eq!(with(|r| r.length = 0), length(0, 4));
    assert_eq!(with(|r| r.length = 2_001), length(2_001, 4));
    assert_eq!(
        with(|r| (r.length, r.periods) = (2_000, 26)),
        length(2_000, 26)
    );
    for peak in [0.0, -1.0, f32::NAN, f32::INFINITY, 1_025.0] {
        let refused = start(
            &stylus,
            &ProbeStart {
                peak_m_s2: peak,
                ..request
            },
        );
        assert!(
            matches!(refused, Err(ProbeError::Peak { .. })),
            "{refused:?}"
        );
    }
    assert!(
        matches!(with(|r| r.crc32 ^= 1), ProbeError::Waveform { loaded } if loaded == request.crc32)
    );
    for through in [ProbeThrough::Stored, ProbeThrough::Proposed] {
        assert_eq!(
            start(&stylus, &ProbeStart { through, ..request }),
            Err(ProbeError::NoResponse)
        );
    }
    let beyond = ProbeLoad {
        offset: MAX_PROBE_SAMPLES as u16,
        samples: [0].into_iter().collect(),
    };
    let refused = stylus.control.borrow_mut().load_probe(LINK, &beyond);
    assert_eq!(
        refused,
        Err(ProbeError::Offset {
            offset: MAX_PROBE_SAMPLES as u16
        })
    );
    stylus.play(play_request("texture 0")).expect("it is there");
    assert_eq!(start(&stylus, &request), Err(ProbeError::Playing));
    // Nobody knows what an unknown coil bears.
    let unset = SteppedStylus::boot();
    let request = load(&unset, &[1, 2, 3], 4);
    let refused = start(&unset, &request);
    assert!(
        matches!(
            refused,
            Err(ProbeError::Refused(PlayError::SettingsNotSet { .. }))
        ),
        "{refused:?}"
    );
}

#[test]
fn a_response_is_stored_by_its_hash_alone_with_its_gain_and_goes_stale_with_the_settings_it_was_made_for()
 {
    let mut stylus = ready();
    let response = response_for(&stylus.hardware().settings);
    let id = response.id();
    let unknown = Err(ResponseError::NoSuchResponse { id });
    assert_eq!(
        set(&mut stylus, ResponseChange::Store { id }),
        unknown,
        "nothing was proposed"
    );
    assert_eq!(propose(&stylus, &response), Ok(id));
    assert_eq!(
        set(&mut stylus, ResponseChange::Clear { id }),
        unknown,
        "nothing is stored"
    );
    let other = stylus.request(async |storage, stage| {
        let change = ResponseChange::Store { id };
        storage.response_set(stage, LinkId::Usb, change).await
    });
    assert_eq!(other, Err(ResponseError::OtherLink { from: LINK }));
    // A change of settings ends the proposal, which was checked with those of before.
    stylus
        .change_settings(&[change(Setting::ForceZero, 5_000.0)])
        .expect("in range");
    assert_eq!(set(&mut stylus, ResponseChange::Store { id }), unknown);
    propose(&stylus, &response).expect("it is valid");
    let state = set(&mut stylus, ResponseChange::Store { id }).expect("it was proposed");
    let stored = state.stored.expect("it was stored");
    assert_eq!(
        (stored.response, stored.id, stored.stale),
        (response, id, SettingSet::NONE)
    );
    assert_eq!(
        (
            state.proposed,
            stylus.hardware().settings.get(Setting::OutputGain)
        ),
        (None, 0.05)
    );
    for (setting, value) in [
        (Setting::OutputGain, 0.04),
        (Setting::AmplifierGain, 2.0),
        (Setting::CoilResistance, 7.0),
    ] {
        let before = stylus.hardware().settings.get(setting);
        stylus
            .change_settings(&[change(setting, value)])
            .expect("in range");
        let stale = stylus
            .control
            .borrow()
            .response()
            .stored
            .expect("it stays")
            .stale;
        assert_eq!(stale, SettingSet::NONE.with(setting, true));
        if setting != Setting::OutputGain {
            let differing = stale;
            assert_eq!(
                propose(&stylus, &response),
                Err(ResponseError::Stale { differing })
            );
        }
        stylus
            .change_settings(&[change(setting, before)])
            .expect("in range");
    }
    let cleared = set(&mut stylus, ResponseChange::Clear { id }).expect("it is stored");
    assert_eq!(cleared, ResponseState::default());
    propose(&stylus, &response).expect("it is valid");
    set(&mut stylus, ResponseChange::Store { id }).expect("it was proposed");
    stylus.reset_settings().expect("nothing is played");
    assert_eq!(stylus.control.borrow().response(), ResponseState::default());
}

#[test]
fn an_equaliser_that_may_not_be_played_is_not_even_proposed() {
    let stylus = ready();
    let response = response_for(&Settings::default());
    let sections = |numerator, denominator| {
        let biquad = Biquad::from_f64(numerator, denominator).expect("in range");
        Sections::new(&[Biquad::IDENTITY, biquad]).expect("there is room")
    };
    let (rate_hz, section) = (10_000, 1);
    for (sections_10khz, refusal) in [
        (
            sections([1.0, 0.0, 0.0], [0.0, 1.0]),
            ResponseError::Poles { rate_hz, section },
        ),
        (
            sections([7.0, 7.0, 7.0], [0.0, 0.0]),
            ResponseError::Gain { rate_hz, section },
        ),
    ] {
        assert_eq!(
            propose(
                &stylus,
                &Response {
                    sections_10khz,
                    ..response
                }
            ),
            Err(refusal)
        );
    }
    let refused = propose(
        &stylus,
        &Response {
            rms_db: f32::NAN,
            ..response
        },
    );
    assert_eq!(refused, Err(ResponseError::NotFinite));
}

/// The texture's own samples through the sections alone, at both rates; at the cost of the sections.
#[test]
fn a_stored_response_equalises_every_texture_and_one_that_no_longer_fits_the_budget_is_refused() {
    for (rate, response) in [5_000, 10_000].map(|hz| (hz, response_for(&Settings::default()))) {
        let bytes = encode(&[texture("one", 8, 1, rate)]).expect("valid");
        let library = Library::decode(&bytes).expect("valid");
        let selection = Selection::Texture("one".try_into().expect("short"));
        let plan = |budget, response| plan_of(&selection, &library, budget, response);
        let (plain, _) = plan(BUDGET, None).expect("it fits");
        let (equalised, _) = plan(BUDGET, Some(&response)).expect("it fits");
        let empty = Response {
            sections_5khz: Sections::NONE,
            sections_10khz: Sections::NONE,
            ..response
        };
        let (same, _) = plan(BUDGET, Some(&empty)).expect("it fits");
        assert_eq!(
            same.worst_case(),
            plain.worst_case(),
            "no section costs nothing"
        );
        let per_tick = rate / 5_000;
        let cost = equalised.worst_case().instructions() * per_tick;
        assert!(plan(cost, Some(&response)).is_ok());
        let refused = plan(cost - 1, Some(&response)).expect_err("it costs more");
        assert!(
            matches!(refused, PlayError::EqualiserOverBudget { sections: 1, .. }),
            "{refused:?}"
        );

        let equaliser = Equaliser::new(&response.sections_5khz.biquads());
        let mut state = EqualiserState::new();
        let [mut plain, mut equalised]: [ScenePlayer<'_>; 2] =
            [plain, equalised].map(|plan| ScenePlayer::new(plan, 3));
        let motion = Motion::new(
            model_format::MillimetresPerSecond(80.0),
            model_format::Newton(1.0),
        )
        .expect("finite");
        let samples = UPDATE_INTERVAL_TICKS * per_tick;
        let mut sum = 0;
        for block in 0..400 {
            // Without contact in the end, so that both fall silent.
            let interaction = if block < 300 {
                Interaction::touching(motion)
            } else {
                Interaction::NONE
            };
            plain.follow(interaction, samples);
            equalised.follow(interaction, samples);
            for _ in 0..samples {
                let (expected, _) = state.process(&equaliser, plain.next_sample());
                let sample = equalised.next_sample();
                assert_eq!(sample, expected, "block {block}");
                sum += u64::from(sample.0.unsigned_abs());
            }
        }
        assert!(
            sum > 0 && equalised.block().stages().is_empty(),
            "silence is exact and free"
        );
    }
}
