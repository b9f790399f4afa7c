//! Ten kilohertz: two samples per tick, and the change of rate through silence.

use std::sync::OnceLock;

use model_format::link::{MotionSource, MuteReason, RecordStartEndpoint, RecordStopEndpoint};
use model_format::scene::{Scene, Surface};
use model_format::{Library, PlayRate, TextureSpec, encode_with_scenes};
use stylus_app::safety::Config;
use stylus_kernel::scene::cost::BUDGET;
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;
use virtual_stylus::motion::Motion;

use crate::device::{CODES, Device, MID_SCALE, MS, PERIOD_NS};
use crate::expected::{Heard, Recorded, explain};
use crate::library;
use crate::play::latched;
use crate::scenes;

/// Most instructions of a tick besides those of its samples: inputs, safety, and what begins a block.
const BESIDES: u32 = 2_400;

fn at_ten_kilohertz(spec: TextureSpec) -> TextureSpec {
    TextureSpec {
        sample_rate_hz: 10_000,
        ..spec
    }
}

fn scene_at_ten_kilohertz(mut scene: Scene) -> Scene {
    scene.sample_rate_hz = 10_000;
    scene
}

/// Textures of both rates; scenes at 10 kHz: of two surfaces of the highest order, and with all effects.
fn bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let slow = scenes::texture("slow", 400);
        let fast = at_ten_kilohertz(scenes::texture("fast", 400));
        let short = at_ten_kilohertz(scenes::texture("fast short", 200));
        let lined = scenes::lined(scenes::texture("lined", 400), 4);
        let fed = at_ten_kilohertz(scenes::fed("fast fed", &lined));
        let surface = Surface::of_texture;
        let both = scenes::two("both", [surface(1), surface(1)], 0.0);
        let first = scenes::tapped(scenes::sticky(surface(3)));
        let second = scenes::sticky(surface(2));
        let mut everything = scenes::two("everything", [first, second], 30.0);
        everything.transition_mm = 20.0;
        let everything = scenes::equalised(everything, 3);
        let scenes = [both, everything].map(scene_at_ten_kilohertz);
        encode_with_scenes(&[slow, fast, short, fed], &scenes).expect("within the limits")
    })
}

fn started() -> Device {
    static FLASH: OnceLock<Contents> = OnceLock::new();
    let flash = FLASH.get_or_init(|| library::flash_with(bytes())).clone();
    Device::started(Options {
        flash,
        ..Options::default()
    })
}

/// Sets a hand that goes over the boundaries of the scenes and back, and a force that taps.
fn touch(device: &mut Device) {
    let pins = scenes::tapping();
    device.stylus.set_pins(pins).expect("the run goes on");
    let start = device.stylus.now_ns();
    let knots = [(0, 40.0), (500, 110.0), (900, -90.0), (1_500, 160.0)];
    let speeds = knots.map(|(ms, speed)| (start + ms * MS, speed));
    let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
    device.stylus.set_motion(motion).expect("the run goes on");
}

/// Plays by `play` for a second, and compares all codes with those that the host computes for `heard`.
fn is_put_out_as_the_host_computes_it(play: impl FnOnce(&mut Device), heard: &Heard<'_>) {
    let mut device = started();
    touch(&mut device);
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    play(&mut device);
    device.stylus.audit_ticks(997).expect("the run goes on");
    device.run_for(1_000 * MS);
    let stopped = device
        .request::<RecordStopEndpoint>(&())
        .expect("it is recorded");
    assert_eq!(stopped.lost_blocks, 0);
    let status = device.status();
    let counted = (
        status.tick.missed,
        status.tick.late_frames,
        status.tick.late_outputs,
        status.output.saturations,
    );
    assert_eq!(counted, (0, 0, 0, 0));
    for audit in device.stylus.take_audits().expect("the run goes on") {
        let from_flash = (audit.flash_fetches, audit.flash_reads);
        assert_eq!(from_flash, (0, 0), "{audit:x?}");
    }
    let recorded = Recorded::of(&device.blocks);
    let codes = latched(&mut device);
    let (began, same_until) = explain(heard, &recorded, &codes, asked);
    let end = recorded.first_tick + recorded.samples.len() as u64;
    assert_eq!(same_until, end, "codes differ, with {began:?}");
    let sounding = codes[began.unmuted as usize..end as usize]
        .as_flattened()
        .iter()
        .filter(|&&code| code != MID_SCALE);
    assert!(sounding.count() > CODES * 2_000, "it is heard");
}

#[test]
fn a_texture_at_ten_kilohertz_is_put_out_as_the_host_computes_it() {
    let library = Library::decode(bytes()).expect("a valid library");
    let texture = library.texture("fast").expect("it is in the library");
    let heard = Heard::of_texture(texture, 77);
    is_put_out_as_the_host_computes_it(
        |device| device.play("fast", MotionSource::Sensors, 77),
        &heard,
    );
}

#[test]
fn a_scene_at_ten_kilohertz_with_all_effects_is_put_out_as_the_host_computes_it() {
    let library = Library::decode(bytes()).expect("a valid library");
    let heard = Heard::of_scene(scenes::plan(&library, "everything"), 5);
    let play = |device: &mut Device| {
        device
            .play_scene("everything", MotionSource::Sensors, 5)
            .expect("it is there");
    };
    is_put_out_as_the_host_computes_it(play, &heard);
}

#[test]
fn a_change_of_rate_and_back_is_within_the_limits_and_at_mid_scale_in_between() {
    let mut device = started();
    // A steady hand, so that nothing but the change is silent.
    scenes::press(&mut device, 1.0);
    let speed = Motion::steady(60.0, 0.01);
    device.stylus.set_motion(speed).expect("the run goes on");
    let settings = device.settings();
    let mut changes = Vec::new();
    let changing =
        |device: &mut Device| device.status().output.mute_counts[MuteReason::Changing as usize];
    let before = changing(&mut device);
    for texture in ["slow", "fast", "slow"] {
        changes.push(device.status().tick.ticks as usize);
        device.play(texture, MotionSource::Sensors, 3);
        device.run_for(450 * MS);
        assert!(device.status().output.mute.is_empty(), "{texture}");
    }
    let status = device.status();
    let counted = (
        status.tick.missed,
        status.tick.late_frames,
        status.tick.late_outputs,
    );
    assert_eq!(counted, (0, 0, 0));
    assert_eq!(changing(&mut device), before + 3);
    let codes = latched(&mut device);
    // The limits of codes are those of both rates.
    let [slow, fast] = PlayRate::ALL.map(|rate| Config::at_rate(&settings, 1.0, rate));
    let limits = (slow.limit_steps(), slow.slew_steps());
    assert_eq!(limits, (fast.limit_steps(), fast.slew_steps()));
    let offsets: Vec<i32> = (codes.as_flattened().iter())
        .map(|&code| i32::from(code) - i32::from(MID_SCALE))
        .collect();
    assert!(offsets.iter().all(|offset| offset.abs() <= limits.0));
    let steps = offsets.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    assert!(steps.max().is_some_and(|most| most <= limits.1));
    // After each change there is silence of a millisecond at least, and then sound for most of the time.
    for (index, &change) in changes.iter().enumerate() {
        let end = changes.get(index + 1).copied().unwrap_or(codes.len());
        let stretch = &codes[change..end];
        let silent = |codes: &[u16; CODES]| *codes == [MID_SCALE; CODES];
        let rest = stretch
            .windows(5)
            .position(|ticks| ticks.iter().all(silent))
            .expect("the output rests");
        assert!(rest < 500, "rest after {rest} ticks");
        let sounding = stretch[rest..].iter().filter(|codes| !silent(codes));
        assert!(sounding.count() > 1_200, "change {index}");
    }
}

/// A tick at 10 kHz keeps its period and its budget, and one at 5 kHz costs what it did before.
#[test]
fn two_samples_of_the_highest_order_fit_in_a_tick_and_its_period_stays() {
    let mut device = started();
    scenes::press(&mut device, 1.0);
    let speed = Motion::steady(20.0, 0.01);
    device.stylus.set_motion(speed).expect("the run goes on");
    let idle = scenes::count(&mut device, "idle", 20);
    device.play_until_heard("slow", MotionSource::Sensors, 3);
    let slow = scenes::count(&mut device, "lattice at 5 kHz", 30);
    device.play_until_heard("fast", MotionSource::Sensors, 3);
    device.run_for(200 * MS);
    device.stylus.take_ticks().expect("the run goes on");
    device.run_for(50 * MS);
    let ticks = device.stylus.take_ticks().expect("the run goes on");
    assert!(ticks.len() > 240, "{}", ticks.len());
    for pair in ticks.windows(2) {
        let late = (pair[1].at_ns - pair[0].at_ns).abs_diff(PERIOD_NS);
        // What a critical section of a task delays.
        assert!(late < 5_000, "{late} ns");
    }
    let fast = scenes::count(&mut device, "lattice at 10 kHz", 30);
    device.run_for(100 * MS);
    let both = scenes::count_scene(&mut device, "both");
    device.play_until_heard("slow", MotionSource::Sensors, 3);
    device.run_for(200 * MS);
    let again = scenes::count(&mut device, "lattice at 5 kHz, again", 30);
    assert_eq!(again.within, slow.within);

    let voice = slow.within - idle.within;
    // Two samples, and the stages of safety for the second one.
    let more = fast.within - idle.within - 2 * voice;
    println!("instructions of the second sample's safety stages: {more}");
    assert!(more < 400, "{more}");
    for count in [fast, both] {
        assert!(count.beginning <= BUDGET + BESIDES, "{count:?}");
    }
    let status = device.status();
    let counted = (
        status.tick.missed,
        status.tick.late_frames,
        status.tick.late_outputs,
    );
    assert_eq!(counted, (0, 0, 0));
}
