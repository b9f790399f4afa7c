//! Scenes: their output, code by code, and the cost of each effect per tick.

use std::sync::OnceLock;

use model_format::link::{
    Activity, MotionSource, MuteReason, MuteReasons, PlayEndpoint, PlayError, RecordStartEndpoint,
    RecordStopEndpoint, Selection,
};
use model_format::scene::{
    Biquad, MotionOfScene, Region, Scene, SceneName, StickSlip, Surface, Tap,
};
use model_format::{CodeSpec, CodebookSpec, ExcitationSpec, Library, LineSpec, LinesSpec, ModulationSpec, NodeSpec, PartsSpec, TextureSpec, encode_with_scenes};
use stylus_kernel::scene::Plan;
use stylus_kernel::scene::cost::{self, StageCost};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;
use virtual_stylus::motion::Motion;
use virtual_stylus::pins::FunctionPins;
use virtual_stylus::tick::Tick;

use crate::device::{CODES, Device, MID_SCALE, MS, PERIOD_NS, play_request};
use crate::expected::{Heard, Recorded, explain};
use crate::library;
use crate::play::{force_code, latched};

/// Textures of the library, by their index in it.
const LATTICE: u8 = 0;
const SHORT_LATTICE: u8 = 1;
const FED_LATTICE: u8 = 2;
const FED_SHORT_LATTICE: u8 = 3;
const FOUR_LINES: u8 = 4;
const ONE_LINE: u8 = 5;
const FED_FOUR_LINES: u8 = 6;

/// Orders of the long textures and of the short ones.
const ORDERS: [u32; 2] = [400, 200];

const HARD: Tap = Tap {
    frequency_hz: 300.0,
    decay_s: 1.0,
    gain_m_s2_per_n_s: 0.05,
    limit_m_s2: 20.0,
};

/// Most instructions by which a tick of a fed lattice may exceed that of a plain one.
const MOST_FED: u32 = 40;

const STICKY: StickSlip = StickSlip {
    period_mm: 1.5,
    duty: 0.6,
    depth: 0.9,
    below_mm_s: 1_000.0,
    above_n: 0.05,
};

/// A texture of small models that differ in their first coefficient only.
pub fn texture(name: &str, order: u32) -> TextureSpec {
    let node = |number: i16| {
        let others = (1..order).map(|stage| (stage % 7) as i16);
        let codes = std::iter::once(1_000 * (number + 1)).chain(others);
        NodeSpec::new(4.0, CodeSpec::lattice(codes.collect()))
    };
    TextureSpec::new(name, &[40.0, 240.0], &[0.5, 2.0], (0..4).map(node).collect())
}

/// The same with so many lines that are locked to place.
pub fn lined(mut spec: TextureSpec, lines: usize) -> TextureSpec {
    let line = |at: usize| LineSpec {
        wavelength_mm: 0.3 + 0.7 * at as f32,
        phase: 9_000 * at as u16,
        amplitudes: (1..=spec.nodes.len())
            .map(|node| 0.3 * node as f32)
            .collect(),
    };
    spec.parts.lines = Some(LinesSpec {
        lines: (0..lines).map(line).collect(),
    });
    spec
}

/// The same texture with codebooks and a level track: half of its nodes have a codebook, and half noise.
pub fn fed(name: &str, spec: &TextureSpec) -> TextureSpec {
    let codebook = CodebookSpec {
        peak: 2.0,
        codes: [127, 0, -127, 0, 0, 0, 0, 0].repeat(125),
    };
    let entries = (0..40).map(|n| if n % 2 == 0 { 1 } else { -1 });
    let modulation = ModulationSpec {
        step_samples: 25,
        entries: entries.collect(),
    };
    TextureSpec {
        name: name.to_owned(),
        parts: PartsSpec {
            excitation: Some(ExcitationSpec {
                codebooks: vec![codebook],
                of_nodes: vec![1, 0, 0, 1],
            }),
            modulation: Some(modulation),
            ..spec.parts.clone()
        },
        ..spec.clone()
    }
}

pub fn name(name: &str) -> SceneName {
    SceneName::try_from(name).expect("short")
}

pub fn of_surface(title: &str, surface: Surface) -> Scene {
    Scene::of_surface(name(title), 5_000, surface)
}

/// The scene with `sections` different sections of the equaliser.
pub fn equalised(mut scene: Scene, sections: usize) -> Scene {
    for section in 0..sections {
        let pole = 0.3 + 0.05 * section as f64;
        let biquad = Biquad::from_f64([0.8, -0.2, 0.1], [-pole, 0.2]).expect("within range");
        scene.equaliser.push(biquad).expect("there is room");
    }
    scene
}

pub fn tapped(mut surface: Surface) -> Surface {
    surface.tap = Some(HARD);
    surface
}

pub fn sticky(mut surface: Surface) -> Surface {
    surface.stick_slip = Some(STICKY);
    surface
}

/// Two surfaces that meet at `boundary_mm`, with a transition of the largest width.
pub fn two(title: &str, surfaces: [Surface; 2], boundary_mm: f32) -> Scene {
    let [first, second] = surfaces;
    let mut scene = of_surface(title, first);
    scene.surfaces.push(second).expect("there is room");
    let region = |start_mm, end_mm, surface| Region {
        start_mm,
        end_mm,
        surface,
    };
    for region in [
        region(-1_000.0, boundary_mm, 0),
        region(boundary_mm, 1_000.0, 1),
    ] {
        scene.regions.push(region).expect("there is room");
    }
    scene.transition_mm = 100.0;
    scene
}

fn everything() -> Scene {
    let first = tapped(sticky(Surface::of_texture(FOUR_LINES)));
    let second = sticky(Surface::of_texture(SHORT_LATTICE));
    let mut scene = equalised(two("everything", [first, second], 30.0), 3);
    scene.transition_mm = 20.0;
    scene
}

/// As [`everything`], of fed textures.
fn fed_everything() -> Scene {
    let mut scene = everything();
    scene.name = name("fed everything");
    for (surface, texture) in scene.surfaces.iter_mut().zip([FED_FOUR_LINES, FED_SHORT_LATTICE]) {
        surface.texture = Some(texture);
    }
    scene
}

fn scenes() -> Vec<Scene> {
    let lattice = || Surface::of_texture(LATTICE);
    let constant = |mut scene: Scene| {
        scene.motion = MotionOfScene::Constant {
            speed_mm_s: 120.0,
            force_n: 1.0,
        };
        scene
    };
    let both = [lattice(), Surface::of_texture(SHORT_LATTICE)];
    let sticky_both = both.clone().map(sticky);
    vec![
        of_surface("lattice", lattice()),
        constant(of_surface("constant", lattice())),
        of_surface("short lattice", Surface::of_texture(SHORT_LATTICE)),
        of_surface("four lines", Surface::of_texture(FOUR_LINES)),
        of_surface("one line", Surface::of_texture(ONE_LINE)),
        of_surface("tap", tapped(lattice())),
        of_surface("sticky", sticky(lattice())),
        equalised(of_surface("one section", lattice()), 1),
        equalised(of_surface("four sections", lattice()), 4),
        equalised(of_surface("eight sections", lattice()), 8),
        equalised(of_surface("tap, four sections", tapped(lattice())), 4),
        two("transition", both.clone(), 0.0),
        two("sticky transition", sticky_both, 0.0),
        two("away from the transition", both, 500.0),
        of_surface("fed", Surface::of_texture(FED_LATTICE)),
        of_surface("short fed", Surface::of_texture(FED_SHORT_LATTICE)),
        of_surface("fed four lines", Surface::of_texture(FED_FOUR_LINES)),
        two(
            "fed transition",
            [FED_LATTICE, FED_SHORT_LATTICE].map(Surface::of_texture),
            0.0,
        ),
        two(
            "fed beside plain",
            [LATTICE, FED_SHORT_LATTICE].map(Surface::of_texture),
            0.0,
        ),
        everything(),
        fed_everything(),
    ]
}

/// A library with all scenes.
pub fn bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let plain = [
            texture("lattice", ORDERS[0]),
            texture("short lattice", ORDERS[1]),
        ];
        let fed = plain
            .each_ref()
            .map(|spec| fed(&format!("fed {}", spec.name), spec));
        let four_lines = lined(texture("four lines", ORDERS[0]), 4);
        let lined = [
            four_lines.clone(),
            lined(texture("one line", ORDERS[0]), 1),
            self::fed("fed four lines", &four_lines),
        ];
        let textures = [&plain[..], &fed, &lined].concat();
        encode_with_scenes(&textures, &scenes()).expect("within the limits")
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

pub fn plan<'a>(library: &Library<'a>, scene: &str) -> Plan<'a> {
    let scene = library.scene(scene).expect("it is in the library");
    Plan::new(&scene, library).expect("it is valid")
}

/// A force that presses and lifts, so that the tool taps repeatedly.
pub fn tapping() -> FunctionPins<impl FnMut(u8, u64) -> u16 + Send> {
    FunctionPins(|channel, at_ns| {
        let phase = at_ns as f64 / 1e9 * std::f64::consts::TAU * 3.1;
        match channel {
            5 => force_code((0.5 + 0.9 * phase.sin()).max(0.0)),
            _ => 0x8000,
        }
    })
}

pub fn press(device: &mut Device, newton: f64) {
    let pins = FunctionPins(move |channel, _| match channel {
        5 => force_code(newton),
        _ => 0x8000,
    });
    device.stylus.set_pins(pins).expect("the run goes on");
}

#[test]
fn a_scene_with_all_effects_and_a_switch_to_another_are_put_out_as_the_host_computes_them() {
    let mut device = started();
    device.stylus.set_pins(tapping()).expect("the run goes on");
    let start = device.stylus.now_ns();
    // Over the boundary, back, and over it again.
    let knots = [(0, 40.0), (500, 110.0), (900, -90.0), (1_500, 160.0)];
    let speeds = knots.map(|(ms, speed)| (start + ms * MS, speed));
    let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
    device.stylus.set_motion(motion).expect("the run goes on");
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    device
        .play_scene("everything", MotionSource::Sensors, 5)
        .expect("it is there");
    device.stylus.audit_ticks(997).expect("the run goes on");
    device.run_for(1_300 * MS);
    let before_switch = device.status();
    let [earliest, latest] = {
        let earliest = device.status().tick.ticks;
        device
            .play_scene("sticky transition", MotionSource::Sensors, 5)
            .expect("it is there");
        [earliest, device.status().tick.ticks]
    };
    device.run_for(400 * MS);
    let stopped = device
        .request::<RecordStopEndpoint>(&())
        .expect("it is recorded");
    assert_eq!(stopped.lost_blocks, 0);
    let status = device.status();
    let counted = (
        status.tick.missed,
        status.tick.late_frames,
        status.tick.late_conversions,
        status.output.saturations,
    );
    assert_eq!(counted, (0, 0, 0, 0));
    assert_eq!(
        status.output.mute_counts, before_switch.output.mute_counts,
        "nothing was muted for the switch"
    );
    let activity = Activity::Playing {
        selection: Selection::Scene(name("sticky transition")),
        motion: MotionSource::Sensors,
    };
    assert_eq!(status.output.activity, activity);
    for audit in device.stylus.take_audits().expect("the run goes on") {
        let from_flash = (audit.flash_fetches, audit.flash_reads);
        assert_eq!(from_flash, (0, 0), "{audit:x?}");
    }

    let recorded = Recorded::of(&device.blocks);
    let codes = latched(&mut device);
    let library = Library::decode(bytes()).expect("a valid library");
    let mut heard = Heard::of_scene(plan(&library, "everything"), 5);
    let (began, same_until) = explain(&heard, &recorded, &codes, asked);
    assert!(
        (earliest..=latest + 20).contains(&same_until),
        "codes differ from tick {same_until} on, with {began:?}; the switch was at {earliest} to {latest}"
    );
    let end = recorded.first_tick + recorded.samples.len() as u64;
    let explained = (earliest - 10..=latest).step_by(10).any(|known| {
        let next = Heard::of_scene(plan(&library, "sticky transition"), 0);
        heard.switch = Some((known, next.plan, next.follower));
        explain(&heard, &recorded, &codes, asked).1 == end
    });
    assert!(
        explained,
        "no switch between {earliest} and {latest} explains the codes"
    );
    let sounding = codes[began.unmuted as usize..end as usize]
        .as_flattened()
        .iter()
        .filter(|&&code| code != MID_SCALE);
    assert!(sounding.count() > CODES * 4_000, "the scenes are heard");
}

/// The bits of two fed voices with all effects, over the transition and back, and of an update that is never late.
#[test]
fn a_scene_of_fed_textures_is_put_out_as_the_host_computes_it() {
    let mut device = started();
    device.stylus.set_pins(tapping()).expect("the run goes on");
    let start = device.stylus.now_ns();
    let knots = [(0, 40.0), (500, 110.0), (900, -90.0), (1_500, 160.0)];
    let speeds = knots.map(|(ms, speed)| (start + ms * MS, speed));
    let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
    device.stylus.set_motion(motion).expect("the run goes on");
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    device
        .play_scene("fed everything", MotionSource::Sensors, 5)
        .expect("it is there");
    device.stylus.audit_ticks(997).expect("the run goes on");
    device.run_for(1_300 * MS);
    let stopped = device
        .request::<RecordStopEndpoint>(&())
        .expect("it is recorded");
    assert_eq!(stopped.lost_blocks, 0);
    let status = device.status();
    let counted = (
        status.tick.missed,
        status.tick.late_frames,
        status.output.saturations,
    );
    assert_eq!(counted, (0, 0, 0));
    for audit in device.stylus.take_audits().expect("the run goes on") {
        let from_flash = (audit.flash_fetches, audit.flash_reads);
        assert_eq!(from_flash, (0, 0), "{audit:x?}");
    }
    let recorded = Recorded::of(&device.blocks);
    let codes = latched(&mut device);
    let library = Library::decode(bytes()).expect("a valid library");
    let heard = Heard::of_scene(plan(&library, "fed everything"), 5);
    let (began, same_until) = explain(&heard, &recorded, &codes, asked);
    let end = recorded.first_tick + recorded.samples.len() as u64;
    assert_eq!(same_until, end, "codes differ, with {began:?}");
    let sounding = codes[began.unmuted as usize..end as usize]
        .as_flattened()
        .iter()
        .filter(|&&code| code != MID_SCALE);
    assert!(sounding.count() > CODES * 3_000, "the scene is heard");
}

#[test]
fn a_scene_that_is_not_there_is_refused_and_what_is_played_goes_on() {
    let mut device = started();
    press(&mut device, 1.0);
    device
        .play_scene("tap", MotionSource::Sensors, 1)
        .expect("it is there");
    device.wait_until_heard();
    let missing = device.play_scene("no such scene", MotionSource::Host, 1);
    let told = PlayError::NoSuchScene {
        name: name("no such scene"),
    };
    assert_eq!(missing, Err(Box::new(told)));
    let output = device.status().output;
    let activity = Activity::Playing {
        selection: Selection::Scene(name("tap")),
        motion: MotionSource::Sensors,
    };
    assert_eq!(
        (output.activity, output.mute),
        (activity, MuteReasons::NONE)
    );
    let louder = model_format::link::PlayRequest {
        gain: 0.5,
        ..play_request("lattice", MotionSource::Sensors, 1)
    };
    let playing = device
        .request::<PlayEndpoint>(&louder)
        .expect("it is there");
    assert!(playing.mute.contains(MuteReason::Changing), "a gain fades");
}

/// Instructions per tick over some milliseconds: of the ticks that begin no block, which are all equal, and the most of
/// those that do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    pub within: u32,
    pub beginning: u32,
}

/// Counts over `millis` milliseconds.
pub fn count(device: &mut Device, what: &str, millis: u64) -> Count {
    let ticks = ticks(device, millis);
    let beginning = |tick: &&Tick| begins_block(&ticks, tick);
    let within: Vec<u32> = ticks
        .iter()
        .filter(|tick| !beginning(tick))
        .map(|tick| tick.instructions)
        .collect();
    let most = ticks.iter().filter(beginning).map(|tick| tick.instructions);
    let count = Count {
        within: within[0],
        beginning: most.max().expect("blocks begin"),
    };
    let uneven = within.iter().find(|&&one| one != count.within);
    assert_eq!(uneven, None, "{what}: {count:?}");
    println!(
        "instructions a tick, {what}: {} / {}",
        count.within, count.beginning
    );
    count
}

fn ticks(device: &mut Device, millis: u64) -> Vec<Tick> {
    device.stylus.take_ticks().expect("the run goes on");
    device.run_for(millis * MS);
    device.stylus.take_ticks().expect("the run goes on")
}

/// One tick of ten hands over to the update, and takes more instructions than each of the others.
fn begins_block(ticks: &[Tick], tick: &Tick) -> bool {
    let of_period = |tick: &Tick| (tick.at_ns + PERIOD_NS / 2) / PERIOD_NS % 10;
    let mut sums = [0u64; 10];
    for tick in ticks {
        sums[of_period(tick) as usize] += u64::from(tick.instructions);
    }
    let most = (0..10)
        .max_by_key(|&place| sums[place])
        .expect("there are ten");
    of_period(tick) == most as u64
}

/// Plays `scene` and counts while it sounds.
pub fn count_scene(device: &mut Device, scene: &str) -> Count {
    device
        .play_scene(scene, MotionSource::Sensors, 3)
        .expect("it is there");
    // Time for the exchange and for the window of the speed.
    device.run_for(200 * MS);
    count(device, scene, 30)
}

/// Plays `scene`, lifts the tool, strikes, and counts while the tap rings.
fn count_struck(device: &mut Device, scene: &str) -> Count {
    device
        .play_scene(scene, MotionSource::Sensors, 3)
        .expect("it is there");
    press(device, 0.0);
    device.run_for(20 * MS);
    press(device, 1.0);
    device.run_for(20 * MS);
    count(device, &format!("{scene}, struck"), 30)
}

fn covers(model: StageCost, each: u32, measured: u32) {
    let modelled = u32::from(model.base) + u32::from(model.each) * each;
    assert!(
        (measured..=measured + measured / 20 + 8).contains(&modelled),
        "{model:?} is {modelled} for {each}, and {measured} are measured"
    );
}

#[test]
fn an_effect_costs_a_tick_what_the_model_says_and_one_that_is_not_called_for_nothing() {
    let mut device = started();
    press(&mut device, 1.0);
    let speed = Motion::steady(20.0, 0.01);
    device.stylus.set_motion(speed).expect("the run goes on");
    let idle = count(&mut device, "idle", 20).within;
    device.play_until_heard("lattice", MotionSource::Sensors, 3);
    let texture = count(&mut device, "texture", 30);
    let lattice = count_scene(&mut device, "lattice");
    assert_eq!(lattice, texture, "a scene of one surface is its texture");
    assert_eq!(count_scene(&mut device, "constant").within, lattice.within);
    // Effects that are present but not active.
    assert_eq!(count_scene(&mut device, "tap").within, lattice.within);
    let away = count_scene(&mut device, "away from the transition");
    assert_eq!(away.within, lattice.within);

    let short_lattice = count_scene(&mut device, "short lattice").within;
    let transition = count_scene(&mut device, "transition").within;
    let sticky_transition = count_scene(&mut device, "sticky transition").within;
    let sticky = count_scene(&mut device, "sticky").within;
    let [one, four, eight] = ["one section", "four sections", "eight sections"]
        .map(|scene| count_scene(&mut device, scene).within);
    let [one_line, four_lines] =
        ["one line", "four lines"].map(|scene| count_scene(&mut device, scene).within);
    let tap = count_struck(&mut device, "tap").within;
    let both = count_struck(&mut device, "tap, four sections").within;

    // The first voice pays for the mix, which two voices share.
    let mix = lattice.within + short_lattice - transition - idle;
    let of_voice = |played: u32| played - idle - mix;
    covers(cost::MIX, 0, mix);
    covers(cost::LATTICE, ORDERS[0], of_voice(lattice.within));
    covers(cost::LATTICE, ORDERS[1], of_voice(short_lattice));
    covers(cost::STICK_SLIP, 0, sticky - lattice.within);
    covers(cost::LINES, 1, one_line - lattice.within);
    covers(cost::LINES, 4, four_lines - lattice.within);
    assert!(four_lines - lattice.within <= 200, "{four_lines}");
    covers(cost::TAP, 0, tap - lattice.within);
    covers(cost::EQUALISER, 1, one - lattice.within);
    covers(cost::EQUALISER, 4, four - lattice.within);
    covers(cost::EQUALISER, 8, eight - lattice.within);

    // The cost of a stage does not depend on the other stages.
    assert_eq!(
        sticky_transition - transition,
        2 * (sticky - lattice.within)
    );
    assert_eq!(both - four, tap - lattice.within);

    // A fed voice's excitation is made below the tick, which takes a few instructions more and no noise.
    let fed = count_scene(&mut device, "fed");
    let more = fed.within.saturating_sub(lattice.within);
    assert!(more <= MOST_FED, "{fed:?}, plain {lattice:?}");
    covers(cost::FED_LATTICE, ORDERS[0], of_voice(fed.within));
    let short_fed = of_voice(count_scene(&mut device, "short fed").within);
    covers(cost::FED_LATTICE, ORDERS[1], short_fed);
    let two_fed = count_scene(&mut device, "fed transition").within;
    assert_eq!(two_fed, fed.within + short_fed);
    let beside = count_scene(&mut device, "fed beside plain").within;
    assert_eq!(beside, lattice.within + short_fed);

    // Without contact the list of stages is empty: neither noise nor filter runs.
    device
        .play_scene("eight sections", MotionSource::Sensors, 3)
        .expect("it is there");
    press(&mut device, 0.0);
    device.run_for(200 * MS);
    let lifted = count(&mut device, "lifted", 20).within;
    assert!(
        lifted - idle <= u32::from(cost::MIX.base),
        "{lifted} lifted, {idle} idle"
    );

    // A fade takes one block, in which the plan is exchanged.
    press(&mut device, 1.0);
    device
        .play_scene("four sections", MotionSource::Sensors, 3)
        .expect("it is there");
    device.run_for(30 * MS);
    device
        .play_scene("lattice", MotionSource::Sensors, 3)
        .expect("it is there");
    let after = ticks(&mut device, 20);
    let within = after.iter().filter(|tick| !begins_block(&after, tick));
    let fading = within.map(|tick| tick.instructions).max();
    let fading = fading.expect("there are ticks");
    println!("instructions a tick, four sections, fading: {fading}");
    covers(cost::FADE_OUT, 0, fading - four);
    let status = device.status();
    assert_eq!((status.tick.missed, status.tick.late_frames), (0, 0));
}
