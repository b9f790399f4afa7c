//! Probes and responses: the codes that are put out, the ends of a probe, and what each request changes.

use fake_stylus::device::{SteppedStylus, change, play_request, response_for};
use fake_stylus::library::{library, texture};
use model_format::link::{
    Activity, LINK_LOST_AFTER_MS, LinkId, MAX_PROBE_SAMPLES, PlayError, ProbeError, ProbeLoad, ProbeStart,
    ProbeStarted, ProbeThrough, Response, ResponseChange, ResponseError, ResponseState, Sections, Selection, Setting,
    SettingSet, Settings, SettingsError, StoredResponse,
};
use model_format::scene::Biquad;
use model_format::{DacCode, Library, OutputSample, PlayRate, encode};
use proptest::prelude::*;
use stylus_app::control::{Device, plan_of};
use stylus_app::safety::{Config, OVERSAMPLING, State};
use stylus_app::{TICKS_PER_MS, UPDATE_INTERVAL_TICKS};
use stylus_kernel::scene::cost::BUDGET;
use stylus_kernel::scene::{Equaliser, EqualiserState};

use crate::budget;

const LINK: LinkId = LinkId::Serial;

fn ready() -> SteppedStylus {
    SteppedStylus::ready(&library(1, 4, 1))
}

/// Loads `period` as a host does, and returns a request to play it `periods` times at 5 kHz.
fn load(stylus: &SteppedStylus, period: &[i16], periods: u16) -> ProbeStart {
    for load in ProbeLoad::parts(period) {
        stylus
            .control
            .borrow_mut()
            .load_probe(LINK, &load)
            .expect("nothing is played");
    }
    ProbeStart::of(period, periods, 7.5)
}

fn start(stylus: &SteppedStylus, request: &ProbeStart) -> Result<ProbeStarted, ProbeError> {
    stylus.control.borrow_mut().start_probe(LINK, request)
}

fn set(stylus: &mut SteppedStylus, change: ResponseChange) -> Result<ResponseState, ResponseError> {
    stylus.request(async |storage, stage| storage.response_set(stage, LINK, change).await)
}

fn propose(stylus: &SteppedStylus, response: &Response) -> Result<u32, ResponseError> {
    stylus.control.borrow_mut().propose_response(LINK, *response)
}

fn change_setting(stylus: &mut SteppedStylus, setting: Setting, value: f32) {
    stylus
        .change_settings(&[change(setting, value)])
        .expect("in range, and nothing is played");
}

/// Runs one tick, with the keep-alives and polls of a host that is heard, and returns its codes.
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

/// Checks every code of a probe, from the request to rest, against a computation by samples, equaliser and safety
/// stages only.
fn check_codes(
    stylus: &SteppedStylus,
    request: &ProbeStart,
    period: &[i16],
    (settings, equaliser): (&Settings, &Equaliser),
) {
    let rate = PlayRate::of(request.rate_hz).expect("it is one");
    let per_tick = rate.samples_per_tick() as usize;
    let started = start(stylus, request).expect("it is playable");
    let count = period.len() * usize::from(request.periods);
    let length = count.div_ceil(per_tick) as u64;
    assert_eq!(started.end_tick, started.first_tick + length);
    let one = (1u32 << OutputSample::FRACTION_BITS) as f32;
    let step = request.peak_m_s2 * one / f32::from(i16::MAX);
    let config = Config::at_rate(settings, 1.0, rate);
    let mut safety = State::with_heat(stylus.hardware().heat());
    let mut state = EqualiserState::new();
    let mut peak = 0;
    loop {
        let (now, muted, codes) = tick(stylus);
        let mut next = |n: usize| {
            let at = now
                .checked_sub(started.first_tick)
                .map(|tick| tick as usize * per_tick + n);
            let at = at.filter(|&at| at < count);
            let sample = at.map_or(0, |at| period[at % period.len()]);
            let sample = OutputSample((f32::from(sample) * step) as i32);
            // Without a section there is no equaliser stage that would round.
            if equaliser.is_empty() {
                return sample;
            }
            state.process(equaliser, sample).0
        };
        let expected = match rate {
            PlayRate::Hz5000 => safety.process(&config, next(0), muted),
            PlayRate::Hz10000 => safety.process_pair(&config, [next(0), next(1)], muted),
        };
        assert_eq!(codes, expected, "tick {now} of {started:?}");
        let offsets = codes.iter().map(|code| code.get().abs_diff(2048));
        peak = offsets.fold(peak, u16::max);
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

    /// The codes agree bit for bit, whatever the waveform, the rate, the phase of the blocks, and the equaliser.
    #[test]
    fn a_probe_puts_out_its_samples_from_the_tick_it_said_and_ends_by_itself(
        period in prop::collection::vec(-32_767i16..=32_767, 1..MAX_PROBE_SAMPLES),
        periods in 2u16..4, wait in 0..UPDATE_INTERVAL_TICKS, fast: bool,
        through in prop::sample::select(vec![ProbeThrough::Nothing, ProbeThrough::Proposed, ProbeThrough::Stored]),
    ) {
        let mut stylus = ready();
        // A short soft start lets even a short probe be heard.
        change_setting(&mut stylus, Setting::SoftStart, 5.0);
        for _ in 0..wait {
            tick(&stylus);
        }
        let response = response_for(&stylus.hardware().settings);
        let id = propose(&stylus, &response).expect("it is valid");
        if through == ProbeThrough::Stored {
            set(&mut stylus, ResponseChange::Store { id }).expect("it was proposed");
        }
        let rate_hz = if fast { 10_000 } else { 5_000 };
        // The probe lasts at least 0.1 s, for the same reason.
        let periods = periods.max((1_000 / period.len()) as u16 + 1);
        let request = ProbeStart { rate_hz, through, ..load(&stylus, &period, periods) };
        let mut settings = stylus.hardware().settings;
        let mut equaliser = Equaliser::NONE;
        if through != ProbeThrough::Nothing {
            settings = settings.with(response.change()).expect("in range");
            equaliser = Equaliser::new(&response.sections_5khz.biquads());
        }
        check_codes(&stylus, &request, &period, (&settings, &equaliser));
        let stored = stylus.control.borrow().response().stored.map(|stored| stored.id);
        prop_assert_eq!(stored, (through == ProbeThrough::Stored).then_some(id));
    }
}

#[test]
fn a_probe_ends_with_a_stop_and_with_a_host_that_is_not_heard_and_may_begin_again() {
    let stylus = ready();
    let request = load(&stylus, &[20_000, -20_000, 10_000, -10_000], 10_000);
    for stops in [true, false] {
        let started = start(&stylus, &request).expect("it is playable");
        while stylus.hardware().now() < started.whole_tick {
            tick(&stylus);
        }
        assert!(stylus.sounds());
        // Meanwhile nothing else begins to play and nothing changes.
        assert_eq!(start(&stylus, &request), Err(ProbeError::Playing));
        let mut control = stylus.control.borrow_mut();
        let held = ProbeError::Refused(PlayError::Held { by: LINK });
        assert_eq!(control.start_probe(LinkId::Usb, &request), Err(held));
        let playing = ResponseError::Settings(SettingsError::Playing);
        let response = response_for(&Settings::default());
        assert_eq!(control.propose_response(LINK, response), Err(playing));
        if stops {
            control.stop().expect("it is played");
        }
        drop(control);
        // The last keep-alive came at the tick before.
        for _ in 0..LINK_LOST_AFTER_MS + 100 {
            stylus.control.millisecond();
        }
        assert!(!stylus.sounds() && stylus.hardware().now() < started.end_tick);
        assert_eq!(stylus.status().output.activity, Activity::Idle);
    }
}

#[test]
fn a_probe_that_cannot_be_played_is_refused_and_says_why() {
    let stylus = ready();
    let request = load(&stylus, &[1, 2, 3], 4);
    // The request, with one field changed.
    let with = |change: &dyn Fn(&mut ProbeStart)| {
        let mut changed = request;
        change(&mut changed);
        changed
    };
    let length = |length, periods| {
        let request = with(&|start| (start.length, start.periods) = (length, periods));
        (request, ProbeError::Length { length, periods })
    };
    let peak = |peak_m_s2| {
        let request = with(&|start| start.peak_m_s2 = peak_m_s2);
        (request, ProbeError::Peak { peak_m_s2 })
    };
    let through = |through| (ProbeStart { through, ..request }, ProbeError::NoResponse);
    let (rate_hz, loaded) = (8_000, request.crc32);
    let other_rate = with(&|start| start.rate_hz = rate_hz);
    let other_waveform = with(&|start| start.crc32 = !loaded);
    for (request, error) in [
        (other_rate, ProbeError::Rate { rate_hz }),
        (other_waveform, ProbeError::Waveform { loaded }),
        length(0, 4),
        length(2_001, 4),
        length(2_000, 26),
        peak(0.0),
        peak(-1.0),
        peak(f32::INFINITY),
        peak(1_025.0),
        through(ProbeThrough::Stored),
        through(ProbeThrough::Proposed),
    ] {
        assert_eq!(start(&stylus, &request), Err(error));
    }
    assert!(start(&stylus, &peak(f32::NAN).0).is_err());
    let offset = MAX_PROBE_SAMPLES as u16;
    let samples = [0].into_iter().collect();
    let load = ProbeLoad { offset, samples };
    let beyond = stylus.control.borrow_mut().load_probe(LINK, &load);
    assert_eq!(beyond, Err(ProbeError::Offset { offset }));
    stylus.play(play_request("texture 0")).expect("it is there");
    assert_eq!(start(&stylus, &request), Err(ProbeError::Playing));
    // Nothing is played before the coil's settings are set, because its limits are unknown.
    let unset = SteppedStylus::boot();
    let refused = start(&unset, &self::load(&unset, &[1, 2, 3], 4));
    let missing = SettingSet::REQUIRED;
    let not_set = ProbeError::Refused(PlayError::SettingsNotSet { missing });
    assert_eq!(refused, Err(not_set));
}

#[test]
fn a_response_is_stored_by_its_hash_alone_and_goes_stale_with_the_settings_it_was_made_for() {
    let mut stylus = ready();
    let response = response_for(&stylus.hardware().settings);
    let id = response.id();
    let [store, clear] = [ResponseChange::Store { id }, ResponseChange::Clear { id }];
    let unknown = Err(ResponseError::NoSuchResponse { id });
    assert_eq!(set(&mut stylus, store), unknown, "nothing was proposed");
    assert_eq!(propose(&stylus, &response), Ok(id));
    assert_eq!(set(&mut stylus, clear), unknown, "nothing is stored");
    let mut control = stylus.control.borrow_mut();
    let other = control.begin_response(LinkId::Usb, store);
    drop(control);
    assert_eq!(other, Err(ResponseError::OtherLink { from: LINK }));
    // A change of settings ends the proposal, which was checked against the previous settings.
    change_setting(&mut stylus, Setting::ForceZero, 5_000.0);
    assert_eq!(set(&mut stylus, store), unknown);
    propose(&stylus, &response).expect("it is valid");
    let state = set(&mut stylus, store).expect("it was proposed");
    let stale = SettingSet::NONE;
    let stored = StoredResponse { response, id, stale };
    assert_eq!((state.stored, state.proposed), (Some(stored), None));
    let gain = stylus.hardware().settings.get(Setting::OutputGain);
    assert_eq!(gain, response.output_gain);
    for setting in [Setting::OutputGain, Setting::AmplifierGain, Setting::CoilResistance] {
        let before = stylus.hardware().settings.get(setting);
        change_setting(&mut stylus, setting, before * 0.75);
        let differing = SettingSet::NONE.with(setting, true);
        let stored = stylus.control.borrow().response().stored;
        assert_eq!(stored.expect("it stays").stale, differing);
        // A response sets the gain itself; the other settings must be those with which it was measured.
        let refused = propose(&stylus, &response).err();
        let stale = ResponseError::Stale { differing };
        assert_eq!(refused, (setting != Setting::OutputGain).then_some(stale));
        change_setting(&mut stylus, setting, before);
    }
    assert_eq!(set(&mut stylus, clear), Ok(ResponseState::default()));
    propose(&stylus, &response).expect("it is valid");
    set(&mut stylus, store).expect("it was proposed");
    stylus.reset_settings().expect("nothing is played");
    assert_eq!(stylus.control.borrow().response(), ResponseState::default());
}

#[test]
fn an_equaliser_that_may_not_be_played_is_not_even_proposed() {
    let stylus = ready();
    let response = response_for(&Settings::default());
    let with = |numerator, denominator| {
        let biquad = Biquad::from_f64(numerator, denominator).expect("in range");
        let sections = Sections::new(&[Biquad::IDENTITY, biquad]);
        let mut response = response_for(&Settings::default());
        response.sections_10khz = sections.expect("there is room");
        response
    };
    let rms_db = f32::NAN;
    let (rate_hz, section) = (10_000, 1);
    for (response, refusal) in [
        (
            with([1.0, 0.0, 0.0], [0.0, 1.0]),
            ResponseError::Poles { rate_hz, section },
        ),
        (
            with([7.0, 7.0, 7.0], [0.0, 0.0]),
            ResponseError::Gain { rate_hz, section },
        ),
        (Response { rms_db, ..response }, ResponseError::NotFinite),
    ] {
        assert_eq!(propose(&stylus, &response), Err(refusal));
    }
}

/// At both rates the sections cost in addition to the texture.
#[test]
fn a_texture_that_no_longer_fits_the_budget_with_a_stored_response_is_refused() {
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
        assert_eq!(same.worst_case(), plain.worst_case(), "no section is free");
        let per_tick = rate / 5_000;
        let cost = equalised.worst_case().instructions() * per_tick;
        assert!(plan(cost, Some(&response)).is_ok());
        let refused = plan(cost - 1, Some(&response));
        assert!(matches!(
            refused,
            Err(PlayError::EqualiserOverBudget { sections: 1, .. })
        ));
    }
}
