//! The output of textures and scenes, compared code by code and instant by instant, at 5 and at 10 kHz, and probes and
//! equalised textures at the pin, compared with what the host computes from their samples and sections.

use std::sync::atomic::AtomicI16;

use fake_stylus::device::response_for;
use model_format::link::{
    ProbeLoad, ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint, ProbeStarted, ProbeThrough, Response, ResponseChange,
    ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, Sections, Setting,
};
use model_format::scene::Biquad;
use model_format::{Library, PlayRate};
use stylus_app::inputs::Follower;
use stylus_board::{ALL, Board};
use stylus_kernel::scene::cost::BUDGET;
use stylus_kernel::scene::{Plan, Wave};
use virtual_stylus::Options;

use crate::cost::{count, count_scene};
use crate::device::{Device, MS, PERIOD_NS};
use crate::expected::{Compared, ExpectedPlay, plays_as_the_host_does, recorded};
use crate::library;
use crate::scenes::{OVER_AND_BACK, fast, force_code, plan, press, tapping};

/// Largest number of instructions of a tick at 10 kHz in addition to those of its samples: inputs, safety, and what
/// begins a block.
const BESIDES: u32 = 2_400;

/// Speeds that rise and fall over the grid of a texture: instants in ms with speeds in mm/s.
const STROKES: [(u64, f64); 5] = [(0, 0.0), (200, 20.0), (500, 260.0), (800, 30.0), (1_000, 190.0)];

/// A force that rises and falls over the grid, and an accelerometer whose axes differ.
fn pins(channel: u8, at_ns: u64) -> u16 {
    let phase = at_ns as f64 / 1e9 * std::f64::consts::TAU * 1.3;
    match channel {
        5 => force_code(0.8 + 0.7 * phase.sin()),
        _ => 0x8000 + u16::from(channel) * 100,
    }
}

fn a_texture_is_played(board: &'static Board, bytes: &[u8], texture: &str) {
    // RAM holds noise, as after power-on.
    let mut device = Device::started(Options {
        ram_noise: Some(2),
        flash: library::with(bytes).flash,
        ..Options::on(board)
    });
    device.set_pins(pins);
    let library = Library::decode(bytes).expect("a valid library");
    let heard = ExpectedPlay::of_texture(library.texture(texture).expect("it is there"), 77);
    plays_as_the_host_does(&mut device, &heard, 1_100, |device| {
        device.move_along(&STROKES);
        device.play(texture, 77);
    });
}

#[test]
fn a_lattice_is_put_out_as_the_host_computes_it_code_for_code() {
    for board in ALL {
        a_texture_is_played(board, &library::small(), "lattice");
    }
}

/// Plays, with the image itself, the texture whose digest all platforms compare. The image puts out codes instead of
/// words.
#[test]
fn the_texture_of_the_digest_is_put_out_as_the_host_computes_it_code_for_code() {
    a_texture_is_played(&ALL[0], &kernel_vectors::digest_library(), "digest");
}

/// A device with a force that taps.
fn touched(bytes: &[u8]) -> Device {
    let mut device = Device::started(library::with(bytes));
    device.set_pins(tapping);
    device
}

fn a_scene_is_played(bytes: &[u8], scene: &str) {
    let library = Library::decode(bytes).expect("a valid library");
    let heard = ExpectedPlay::of_scene(plan(&library, scene), 5);
    let Compared { audits, .. } = plays_as_the_host_does(&mut touched(bytes), &heard, 1_300, |device| {
        device.move_along(&OVER_AND_BACK);
        device.play_scene(scene, 5);
    });
    assert!(audits > 0);
}

#[test]
fn a_scene_at_ten_kilohertz_with_all_effects_is_put_out_as_the_host_computes_it() {
    a_scene_is_played(&fast(), "everything");
}

/// A scene of two fed voices with all effects, over the transition and back. Every bit is compared, and no update may
/// be late.
#[test]
fn a_scene_of_fed_textures_is_put_out_as_the_host_computes_it() {
    a_scene_is_played(&crate::scenes::bytes(), "fed everything");
}

/// A tick at 10 kHz keeps its period and its budget. A tick at 5 kHz costs as much as before.
#[test]
fn two_samples_of_the_highest_order_fit_in_a_tick_and_its_period_stays() {
    let mut device = Device::started(library::with(&fast()));
    press(&mut device, 1.0);
    device.move_at(20.0);
    let idle = count(&mut device, "idle", 20);
    device.play_until_heard("slow");
    let slow = count(&mut device, "lattice at 5 kHz", 30);
    device.play_until_heard("fast");
    device.run_for(200 * MS);
    device.stylus.take_ticks();
    device.run_for(50 * MS);
    let ticks = device.stylus.take_ticks();
    assert!(ticks.len() > 240, "{}", ticks.len());
    for pair in ticks.windows(2) {
        let late = (pair[1].at_ns - pair[0].at_ns).abs_diff(PERIOD_NS);
        // A critical section of a task may delay the tick by this much.
        assert!(late < 5_000, "{late} ns");
    }
    let fast = count(&mut device, "lattice at 10 kHz", 30);
    device.run_for(100 * MS);
    let both = count_scene(&mut device, "both");
    device.play_until_heard("slow");
    device.run_for(200 * MS);
    let again = count(&mut device, "lattice at 5 kHz, again", 30);
    assert_eq!(again.within, slow.within);

    let voice = slow.within - idle.within;
    // The difference consists of two samples, and of the safety stages for the second one.
    let more = fast.within - idle.within - 2 * voice;
    assert!(more < 400, "{more}");
    for count in [fast, both] {
        assert!(count.beginning <= BUDGET + BESIDES, "{count:?}");
    }
    device.assert_undisturbed();
}

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
