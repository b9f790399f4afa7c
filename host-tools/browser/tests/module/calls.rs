//! The place of a motion as the module tells it, against the kernel's own.

use kernel_vectors::{digest_library, scenes, specs};
use model_format::scene::{Surface, Tap};
use model_format::{Library, MillimetresPerSecond, Newton, encode_with_scenes};
use stylus_browser::{BlockMotion, STATE_NUMBERS};
use stylus_kernel::Motion;
use stylus_kernel::grid::{GridPoint, ONE};

use crate::wasm::Wasm;

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
