//! A session plays what `stylus render` plays, changes without a click, and tells the place of a motion as the kernel
//! has it.

use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use kernel_vectors::{digest_library, scenes, specs};
use model_format::scene::{Surface, Tap};
use model_format::{Library, MillimetresPerSecond, Newton, OutputSample, encode, encode_with_scenes};
use stylus_browser::{BlockMotion, STATE_NUMBERS, Selection, Session, Without};
use stylus_kernel::Motion;
use stylus_kernel::grid::{GridPoint, ONE};

use crate::Wasm;

const BLOCK: usize = 10;

/// The motion at each block, as a page that reads such a file would tell it.
fn blocks(path: &MotionPath, count: usize) -> Vec<BlockMotion> {
    let block = |index: usize| {
        let begin_s = (index * BLOCK) as f64 / 5000.0;
        let end_s = begin_s + (BLOCK - 1) as f64 / 5000.0;
        let (speed, force) = path.values_at(begin_s);
        BlockMotion {
            begin_mm: path.position_mm_at(begin_s),
            end_mm: path.position_mm_at(end_s),
            ..BlockMotion::new(f64::from(speed.0), f64::from(force.0))
        }
    };
    (0..count).map(block).collect()
}

fn played(session: &mut Session<'_>, motions: &[BlockMotion]) -> Vec<OutputSample> {
    let mut outputs = vec![OutputSample::SILENCE; motions.len() * BLOCK];
    for (motions, outputs) in motions.chunks(100).zip(outputs.chunks_mut(100 * BLOCK)) {
        session.play(motions, outputs).expect("it is finite");
    }
    outputs
}

fn choose(session: &mut Session<'_>, texture: usize, seed: u64) {
    session
        .choose(Selection::Texture(texture), Without::default(), seed)
        .expect("it is there");
}

#[test]
fn a_stroke_is_played_as_render_plays_it() {
    let bytes = digest_library();
    let library = Library::decode(&bytes).expect("it is valid");
    let texture = library.texture_at(0).expect("there is one");
    let folder = tempfile::tempdir().expect("it can be made");
    let file = folder.path().join("stroke.csv");
    let rows = "time_s,speed_mm_s,force_n\n0,0,0\n0.3,90,0.7\n0.8,-150,1.4\n1.2,33.3,0\n1.5,180,0.9\n2,0,0\n";
    std::fs::write(&file, rows).expect("it is written");
    let path = MotionPath::from_csv(&file).expect("it is a motion");
    let rendering = Rendering::new(texture, &path, 2.0, 77).expect("it is short");
    let rendered: Vec<OutputSample> = rendering.collect();
    let mut session = Session::new(library);
    choose(&mut session, 0, 77);
    assert_eq!(played(&mut session, &blocks(&path, 1000)), rendered);
}

#[test]
fn a_choice_at_rest_plays_as_the_first_choice_of_a_session_does() {
    let bytes = encode(&specs()[..2]).expect("they are lattices");
    let library = Library::decode(&bytes).expect("it is valid");
    let rubbed = [BlockMotion::new(100.0, 1.0); 30];
    let mut fresh = Session::new(library);
    choose(&mut fresh, 1, 5);
    let expected = played(&mut fresh, &rubbed);
    let mut used = Session::new(library);
    choose(&mut used, 0, 4);
    played(&mut used, &rubbed);
    played(&mut used, &[BlockMotion::new(0.0, 0.0); 5]);
    choose(&mut used, 1, 5);
    assert_eq!(played(&mut used, &rubbed), expected);
}

/// Between two choices the level goes to 0 within a block, and comes from 0 in the next.
#[test]
fn a_choice_while_something_sounds_fades_and_then_plays_from_its_seed() {
    let bytes = encode(&specs()[..2]).expect("they are lattices");
    let library = Library::decode(&bytes).expect("it is valid");
    let rubbed = [BlockMotion::new(100.0, 1.0); 40];
    let mut session = Session::new(library);
    choose(&mut session, 0, 4);
    let before = played(&mut session, &rubbed);
    choose(&mut session, 1, 5);
    let after = played(&mut session, &rubbed);
    assert_eq!(after[BLOCK - 1], OutputSample::SILENCE, "the end of the fade");
    assert!(after[..BLOCK - 1].iter().any(|&word| word != OutputSample::SILENCE));
    let mut fresh = Session::new(library);
    choose(&mut fresh, 1, 5);
    let expected = played(&mut fresh, &rubbed);
    assert_eq!(after[BLOCK..], expected[..expected.len() - BLOCK]);
    // The fade is that of the texture before: no step is larger than those of its playing.
    let steps = |words: &[OutputSample]| {
        words
            .windows(2)
            .map(|pair| pair[0].0.abs_diff(pair[1].0))
            .max()
            .unwrap_or(0)
    };
    let fade: Vec<OutputSample> = before[before.len() - 1..]
        .iter()
        .chain(&after[..BLOCK])
        .copied()
        .collect();
    assert!(steps(&fade) <= steps(&before), "{} {}", steps(&fade), steps(&before));
}

/// A scene of the first two lattices in two regions side by side, with a transition of 4 mm between them.
fn library_with_a_scene() -> Vec<u8> {
    let tapped = Surface {
        tap: Some(Tap {
            frequency_hz: 150.0,
            decay_s: 0.02,
            gain_m_s2_per_n_s: 0.1,
            limit_m_s2: 5.0,
        }),
        ..Surface::of_texture(1)
    };
    let quiet = Surface {
        gain: 0.5,
        ..Surface::of_texture(0)
    };
    let scene = scenes::side_by_side("a path", [tapped, quiet], [0.0, 10.0, 20.0], 4.0);
    encode_with_scenes(&specs()[..2], &[scene]).expect("it is valid")
}

/// The state after a block of this motion at a place.
fn state_at(wasm: &mut Wasm, speed_mm_s: f64, force_n: f64, position_mm: f64) -> Vec<f64> {
    let there = BlockMotion {
        begin_mm: position_mm,
        end_mm: position_mm,
        ..BlockMotion::new(speed_mm_s, force_n)
    };
    wasm.run(&[there]).expect("it is finite");
    wasm.doubles("state", STATE_NUMBERS)
}

#[test]
fn the_place_on_the_grid_is_the_kernels() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes)
        .expect("it is valid")
        .texture_at(0)
        .expect("there is one");
    let mut wasm = Wasm::with(&bytes);
    assert_eq!(wasm.call("choose_texture", (0u32, 0u32, 3u32, 0u32)), 0);
    for (speed, force) in [(75.0, 1.3), (10.0, 0.2), (500.0, 9.0), (-120.0, 2.0), (0.0, 1.0)] {
        let state = state_at(&mut wasm, speed, force, 5.0);
        let motion = Motion::new(MillimetresPerSecond(speed as f32), Newton(force as f32)).expect("it is finite");
        let point = GridPoint::locate(&texture, motion);
        let share = |steps: u32| f64::from(steps) / f64::from(ONE);
        assert_eq!((state[0], state[1], state[3]), (5.0, 1.0, 1.0));
        assert_eq!(state[4..8], [0.0, 0.0, 1.0, share(point.fade)]);
        let nodes = point.nodes.map(|(speed, force)| (speed * 2 + force) as f64);
        assert_eq!(state[8..12], nodes);
        assert_eq!(state[12..16], point.weights.map(share));
        assert_eq!(
            state[16..18],
            [f64::from(motion.speed_mm_s()), f64::from(motion.force_n())]
        );
    }
}

#[test]
fn on_a_transition_both_surfaces_are_told_with_their_gains() {
    let mut wasm = Wasm::with(&library_with_a_scene());
    assert_eq!(wasm.call("choose_scene", (0u32, 0u32, 3u32, 0u32)), 0);
    let voices = |wasm: &mut Wasm, position: f64| {
        let state = state_at(wasm, 100.0, 1.0, position);
        let voice = |at: usize| [state[at], state[at + 1], state[at + 2]];
        (state[3], voice(4), voice(18))
    };
    let (count, first, _) = voices(&mut wasm, 5.0);
    assert_eq!((count, first), (1.0, [0.0, 1.0, 1.0]));
    let (count, first, second) = voices(&mut wasm, 10.0);
    assert_eq!(count, 2.0);
    assert_eq!((first[0], first[1], second[0], second[1]), (1.0, 0.0, 0.0, 1.0));
    // Equal power in the middle, and half the gain on one of them.
    let half = 0.5f64.sqrt();
    assert!((second[2] - half).abs() < 1e-3, "{second:?}");
    assert!((first[2] - 0.5 * half).abs() < 1e-3, "{first:?}");
    assert_eq!(voices(&mut wasm, 30.0).0, 0.0);
}
