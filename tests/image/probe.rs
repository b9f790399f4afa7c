//! Probes and equalised textures at the pin, compared with what the host computes from their samples and sections.

use std::sync::atomic::AtomicI16;

use fake_stylus::device::response_for;
use model_format::link::{
    ProbeLoad, ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint, ProbeStarted, ProbeThrough, Response, ResponseChange,
    ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, Sections, Setting,
};
use model_format::scene::Biquad;
use model_format::{Library, PlayRate};
use stylus_app::inputs::Follower;
use stylus_kernel::scene::{Plan, Wave};

use crate::device::{Device, MS};
use crate::expected::{ExpectedPlay, plays_as_the_host_does, recorded};
use crate::library;
use crate::scenes::{fast, press};

/// A period of a waveform without symmetry, long enough to need more than one part for loading.
const WAVE: [i16; 317] = {
    let mut wave = [0; 317];
    let mut at = 0;
    while at < wave.len() {
        wave[at] = (at * at * 211 + at * 7_919) as i16;
        at += 1;
    }
    wave
};

/// Loads the waveform, and returns the request that plays it.
pub fn load(device: &mut Device) -> ProbeStart {
    for load in ProbeLoad::parts(&WAVE) {
        device.request::<ProbeLoadEndpoint>(&load).expect("nothing is played");
    }
    ProbeStart::of(&WAVE, 40, 12.5)
}

pub fn start(device: &mut Device, request: ProbeStart) -> ProbeStarted {
    device.keep_alive(true);
    device.request::<ProbeStartEndpoint>(&request).expect("it is playable")
}

/// Proposes a response of `count` sections, made for the settings in force.
fn propose(device: &mut Device, count: usize) -> Response {
    let section = |number: usize| {
        let pole = 0.1 * number as f64;
        Biquad::from_f64([0.9, -0.2, 0.1], [-pole, 0.3]).expect("in range")
    };
    let all: Vec<Biquad> = (0..count).map(section).collect();
    let sections = Sections::new(&all).expect("there is room");
    let settings = device.settings();
    let response = Response {
        sections_5khz: sections,
        sections_10khz: sections,
        output_gain: settings.get(Setting::OutputGain),
        ..response_for(&settings)
    };
    let id = device.request::<ResponseProposeEndpoint>(&response);
    assert_eq!(id, Ok(response.id()));
    response
}

/// Proposes a response like [`propose`], and stores it.
pub fn store(device: &mut Device, count: usize) -> Response {
    let response = propose(device, count);
    // While the bank with the settings is written, the serial line would lose what is sent.
    device.keep_alive(false);
    let id = response.id();
    let stored = device
        .request::<ResponseSetEndpoint>(&ResponseChange::Store { id })
        .expect("it was proposed")
        .stored;
    assert_eq!(stored.map(|stored| stored.response), Some(response));
    response
}

#[test]
fn a_probe_at_ten_kilohertz_passes_the_proposed_equaliser_from_its_tick_to_its_end_and_stores_nothing() {
    let rate = PlayRate::Hz10000;
    let mut device = Device::with_library();
    let response = propose(&mut device, 3);
    let request = ProbeStart {
        rate_hz: rate.hz(),
        through: ProbeThrough::Proposed,
        ..load(&mut device)
    };
    let mut started = None;
    let compared = recorded(&mut device, |device| {
        started = Some(start(device, request));
        // The probe plays to its own end, and to the end of its mute: 40 periods of 317 samples take 1.27 s.
        device.run_for(1_400 * MS);
        device.keep_alive(false);
    });
    let samples: [AtomicI16; WAVE.len()] = WAVE.map(AtomicI16::new);
    let wave = Wave {
        samples: &samples,
        total: u32::from(request.length) * u32::from(request.periods),
        peak_m_s2: request.peak_m_s2,
        first_tick: started.expect("it was started").first_tick,
    };
    let mut plan = Plan::of_wave(wave, rate.hz());
    plan.append(&response.sections_10khz.biquads());
    let heard = ExpectedPlay {
        plan,
        follower: Follower::new(false),
        seed: 0,
        switch: None,
    };
    let (began, same_until) = compared.explained(&heard);
    // The reference continues to play, so its codes differ from the mute at the probe's end.
    let end = started.expect("it was started").end_tick;
    assert!(same_until >= end, "codes differ from {same_until} on, with {began:?}");
    compared.assert_heard(began);
    let state = device.request::<ResponseGetEndpoint>(&());
    assert_eq!((state.stored, state.proposed), (None, Some(response.id())));
}

#[test]
fn a_texture_is_equalised_by_the_stored_response_after_a_restart_too() {
    let bytes = fast();
    let mut device = Device::started(library::with(&bytes));
    let response = store(&mut device, 3);
    let flash = device.stylus.flash();
    let mut device = Device::started(library::of(flash));
    press(&mut device, 1.0);
    let library = Library::decode(&bytes).expect("a valid library");
    let texture = library.texture("fast").expect("it is there");
    let mut heard = ExpectedPlay::of_texture(texture, 77);
    heard.plan.append(&response.sections_10khz.biquads());
    plays_as_the_host_does(&mut device, &heard, 500, |device| {
        device.move_at(60.0);
        device.play("fast", 77);
    });
}
