//! Scenes, and libraries with scenes, at 5 and at 10 kHz.

use kernel_vectors::scenes::{self, of_surface, side_by_side, sticky, tapped};
use model_format::link::{Activity, MotionSource};
use model_format::scene::{MotionOfScene, Scene, Surface};
use model_format::{
    CodeSpec, CodebookSpec, ExcitationSpec, Library, LineSpec, LinesSpec, NodeFlags, NodeSpec, PartsSpec, TextureSpec,
    Wander, encode_with_scenes,
};
use stylus_kernel::scene::Plan;

use crate::device::{Device, MS};
use crate::expected::ExpectedPlay;
use crate::expected::recorded;
use crate::library;
use crate::requests::scene_request;

/// Textures of the library, by their index.
const LATTICE: u8 = 0;
const SHORT_LATTICE: u8 = 1;
const FED_LATTICE: u8 = 2;
const FED_SHORT_LATTICE: u8 = 3;
const FOUR_LINES: u8 = 4;
const ONE_LINE: u8 = 5;
const FED_FOUR_LINES: u8 = 6;

/// Orders of the long textures and of the short ones.
pub const ORDERS: [u32; 2] = [400, 200];

/// A texture of small models that differ only in their first coefficient.
fn texture(name: &str, order: u32) -> TextureSpec {
    let node = |number: i16| {
        let rest = (1..order).map(|stage| (stage % 7) as i16);
        let codes = std::iter::once(1_000 * (number + 1)).chain(rest);
        NodeSpec {
            output_power: 4.0,
            prediction_error_power: 4.0,
            flags: NodeFlags::NONE,
            codes: CodeSpec::lattice(codes.collect()),
        }
    };
    TextureSpec {
        speed_axis_mm_s: vec![40.0, 240.0],
        force_axis_n: vec![0.5, 2.0],
        nodes: (0..4).map(node).collect(),
        ..fake_stylus::library::texture(name, 1, 0, 5_000)
    }
}

/// Returns `spec` with `lines` lines that are tied to position. The first line has wander.
fn lined(mut spec: TextureSpec, lines: usize) -> TextureSpec {
    let line = |at: usize| LineSpec {
        wavelength_mm: 0.3 + 0.7 * at as f32,
        phase: 9_000 * at as u16,
        amplitudes: (1..=spec.nodes.len()).map(|node| 0.3 * node as f32).collect(),
        wander: (at == 0).then_some(0),
    };
    let wander = Wander {
        rms_mm: 0.05,
        correlation_mm: 3.0,
        clock_mm_s: 0.0,
    };
    let lines = (0..lines).map(line).collect();
    spec.parts.lines = Some(LinesSpec::with_wanders(lines, &[wander]));
    spec
}

/// Returns the texture of `spec` with a codebook. Half of its nodes use it, and half use noise.
fn fed(name: &str, spec: &TextureSpec) -> TextureSpec {
    // All eight codes in turn, in blocks of two levels.
    let block = |n: i8| [[0x88, 0xc6, 0xfa].repeat(8), vec![(-12 * (n % 2)).cast_unsigned()]].concat();
    let excitation = ExcitationSpec {
        codebooks: vec![CodebookSpec::of_unit_power((0..16).flat_map(block).collect())],
        of_nodes: vec![1, 0, 0, 1],
    };
    TextureSpec {
        name: name.to_owned(),
        parts: PartsSpec {
            excitation: Some(excitation),
            ..spec.parts.clone()
        },
        ..spec.clone()
    }
}

/// Two surfaces that meet at `boundary_mm`, with a transition of the largest width.
fn two(title: &str, surfaces: [Surface; 2], boundary_mm: f32) -> Scene {
    side_by_side(title, surfaces, [-1_000.0, boundary_mm, 1_000.0], 100.0)
}

fn everything(textures: [u8; 2]) -> Scene {
    let [first, second] = textures.map(|texture| sticky(Surface::of_texture(texture)));
    let mut scene = scenes::equalised(two("everything", [tapped(first), second], 30.0), 3);
    scene.transition_mm = 20.0;
    scene
}

fn scenes() -> Vec<Scene> {
    let of = Surface::of_texture;
    let lattice = || of(LATTICE);
    let mut constant = of_surface("constant", lattice());
    constant.motion = MotionOfScene::Constant {
        speed_mm_s: 120.0,
        force_n: 1.0,
    };
    let both = || [lattice(), of(SHORT_LATTICE)];
    let fed_everything = Scene {
        name: "fed everything".try_into().expect("it is short"),
        ..everything([FED_FOUR_LINES, FED_SHORT_LATTICE])
    };
    let equalised = |title, sections| scenes::equalised(of_surface(title, lattice()), sections);
    vec![
        of_surface("lattice", lattice()),
        constant,
        of_surface("short lattice", of(SHORT_LATTICE)),
        of_surface("four lines", of(FOUR_LINES)),
        of_surface("one line", of(ONE_LINE)),
        of_surface("tap", tapped(lattice())),
        of_surface("sticky", sticky(lattice())),
        equalised("one section", 1),
        equalised("four sections", 4),
        equalised("eight sections", 8),
        scenes::equalised(of_surface("tap, four sections", tapped(lattice())), 4),
        two("transition", both(), 0.0),
        two("sticky transition", both().map(sticky), 0.0),
        two("away from the transition", both(), 500.0),
        of_surface("fed", of(FED_LATTICE)),
        of_surface("short fed", of(FED_SHORT_LATTICE)),
        two("fed transition", [FED_LATTICE, FED_SHORT_LATTICE].map(of), 0.0),
        two("fed beside plain", [LATTICE, FED_SHORT_LATTICE].map(of), 0.0),
        everything([FOUR_LINES, SHORT_LATTICE]),
        fed_everything,
    ]
}

/// A library with all scenes.
pub fn bytes() -> Vec<u8> {
    let plain = [texture("lattice", ORDERS[0]), texture("short lattice", ORDERS[1])];
    let four_lines = lined(texture("four lines", ORDERS[0]), 4);
    let textures = [
        plain[0].clone(),
        plain[1].clone(),
        fed("fed lattice", &plain[0]),
        fed("fed short lattice", &plain[1]),
        four_lines.clone(),
        lined(texture("one line", ORDERS[0]), 1),
        fed("fed four lines", &four_lines),
    ];
    encode_with_scenes(&textures, &scenes()).expect("within the limits")
}

/// A library with textures of both rates. Its scenes at 10 kHz are one of two surfaces of the highest order, and one
/// with all effects.
pub fn fast() -> Vec<u8> {
    let at_ten_kilohertz = |spec: TextureSpec| TextureSpec {
        sample_rate_hz: 10_000,
        ..spec
    };
    let slow = texture("slow", ORDERS[0]);
    let fast = at_ten_kilohertz(texture("fast", ORDERS[0]));
    let lined = lined(texture("lined", ORDERS[0]), 4);
    let fed = at_ten_kilohertz(fed("fast fed", &lined));
    let both = two("both", [1, 1].map(Surface::of_texture), 0.0);
    let scenes = [both, everything([2, 1])].map(|mut scene| {
        scene.sample_rate_hz = 10_000;
        scene
    });
    encode_with_scenes(&[slow, fast, fed], &scenes).expect("within the limits")
}

pub fn plan<'a>(library: &Library<'a>, scene: &str) -> Plan<'a> {
    let scene = library.scene(scene).expect("it is in the library");
    Plan::new(&scene, library).expect("it is valid")
}

/// Code of the ADC for a force. By default the sensor has 2 N/V, with its zero at a sixteenth of the range.
pub fn force_code(newton: f64) -> u16 {
    4_096 + (newton / 2.0 / 3.3 * 65_536.0) as u16
}

/// A force that presses and lifts repeatedly, so that the tool taps.
pub fn tapping(channel: u8, at_ns: u64) -> u16 {
    let phase = at_ns as f64 / 1e9 * std::f64::consts::TAU * 3.1;
    match channel {
        5 => force_code((0.5 + 0.9 * phase.sin()).max(0.0)),
        _ => 0x8000,
    }
}

/// A hand that moves over the boundary of the scenes, back, and over it again.
pub const OVER_AND_BACK: [(u64, f64); 4] = [(0, 40.0), (500, 110.0), (900, -90.0), (1_500, 160.0)];

pub fn press(device: &mut Device, newton: f64) {
    device.set_pins(move |channel, _| match channel {
        5 => force_code(newton),
        _ => 0x8000,
    });
}

#[test]
fn a_scene_with_all_effects_and_a_switch_to_another_are_put_out_as_the_host_computes_them() {
    let bytes = bytes();
    let mut device = Device::started(library::with(&bytes));
    device.set_pins(tapping);
    let mut switched = 0..0;
    let compared = recorded(&mut device, |device| {
        device.move_along(&OVER_AND_BACK);
        device.play_scene("everything", 5);
        device.run_for(1_300 * MS);
        let before = device.status();
        device.play_scene("sticky transition", 5);
        let after = device.status();
        switched = before.tick.ticks..after.tick.ticks;
        device.run_for(400 * MS);
        assert_eq!(
            after.output.mute_counts, before.output.mute_counts,
            "nothing was muted for the switch"
        );
    });
    let activity = Activity::Playing {
        selection: scene_request("sticky transition", 5).selection,
        motion: MotionSource::Sensors,
    };
    assert_eq!(device.status().output.activity, activity);
    let library = Library::decode(&bytes).expect("a valid library");
    let mut heard = ExpectedPlay::of_scene(plan(&library, "everything"), 5);
    let (began, same_until) = compared.explained(&heard);
    assert!(
        (switched.start..=switched.end + 20).contains(&same_until),
        "codes differ from tick {same_until} on, with {began:?}; the switch was in {switched:?}"
    );
    // The first update after the answer must already use the new scene.
    let is_explained = (switched.start - 10..=switched.end + 10).step_by(10).any(|known| {
        let next = ExpectedPlay::of_scene(plan(&library, "sticky transition"), 0);
        heard.switch = Some((known, next.plan, next.follower));
        compared.explained_from(&heard, began) == compared.end()
    });
    assert!(is_explained, "no switch in {switched:?} explains the codes");
    compared.assert_heard(began);
}
