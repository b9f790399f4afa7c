//! The module's words are the kernel's, for every structure and part, and for motions of any kind.

use std::sync::LazyLock;

use kernel_vectors::{DIGESTED, digest_library, scenes};
use model_format::{Library, OutputSample, SAMPLE_RATE_HZ, encode, encode_with_scenes};
use proptest::prelude::*;
use stylus_browser::{BlockMotion, Selection, Session, Without};

use crate::Wasm;

/// The textures that every processor must play to the same bits, and a scene with all effects.
static LIBRARY: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let scene = scenes::with_all_effects(SAMPLE_RATE_HZ);
    encode_with_scenes(&kernel_vectors::specs(), &[scene]).expect("within the limits")
});

/// Motions of any kind: slow and fast, light and heavy, at rest and off the grid; with and without positions and
/// contact.
fn motion() -> impl Strategy<Value = BlockMotion> {
    let speed = prop_oneof![
        4 => -400.0..400.0f64,
        1 => Just(0.0),
        1 => Just(1e9),
        1 => -1e-30..1e-30f64,
    ];
    let force = prop_oneof![4 => -0.5..4.0f64, 1 => Just(0.0), 1 => Just(1e20), 1 => 0.0..0.03f64];
    let place = prop_oneof![
        2 => Just(None),
        4 => (-60.0..60.0f64).prop_map(Some),
        1 => Just(Some(1e12)),
        1 => Just(Some(-1e300)),
    ];
    let contact = prop_oneof![3 => Just(f64::NAN), 1 => Just(0.0), 1 => Just(1.0)];
    (speed, force, place, -2.0..2.0f64, contact).prop_map(|(speed_mm_s, force_n, begin, way, contact)| BlockMotion {
        begin_mm: begin.unwrap_or(f64::NAN),
        end_mm: begin.map_or(f64::NAN, |begin| begin + way),
        contact,
        ..BlockMotion::new(speed_mm_s, force_n)
    })
}

/// Motions that stay for a while, as those of a hand do.
fn motions() -> impl Strategy<Value = Vec<BlockMotion>> {
    let held = (motion(), 1usize..12);
    prop::collection::vec(held, 1..16).prop_map(|held| {
        held.into_iter()
            .flat_map(|(motion, times)| std::iter::repeat_n(motion, times))
            .collect()
    })
}

#[derive(Clone, Debug)]
struct Choice {
    selection: Selection,
    without: u32,
    seed: u64,
}

fn choice() -> impl Strategy<Value = Choice> {
    let textures = Library::decode(&LIBRARY).expect("it is valid").len();
    let selection = prop_oneof![
        4 => (0..textures).prop_map(Selection::Texture),
        1 => Just(Selection::Scene(0)),
    ];
    (selection, 0u32..8, any::<u64>()).prop_map(|(selection, without, seed)| Choice {
        selection,
        without,
        seed,
    })
}

fn choose(wasm: &mut Wasm, choice: &Choice) {
    let (low, high) = (choice.seed as u32, (choice.seed >> 32) as u32);
    let (name, index) = match choice.selection {
        Selection::Texture(index) => ("choose_texture", index),
        Selection::Scene(index) => ("choose_scene", index),
    };
    let chosen = wasm.call(name, (index as u32, choice.without, low, high));
    assert_eq!(chosen, 0, "{}", wasm.text());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// One choice after another, so that fades between them are compared too.
    #[test]
    fn the_module_plays_the_kernels_words_whatever_is_chosen_and_however_it_is_rubbed(
        parts in prop::collection::vec((choice(), motions()), 1..3)
    ) {
        let mut wasm = Wasm::with(&LIBRARY);
        let mut session = Session::new(Library::decode(&LIBRARY).expect("it is valid"));
        for (choice, motions) in parts {
            choose(&mut wasm, &choice);
            let without = Without::of_bits(choice.without);
            session.choose(choice.selection, without, choice.seed).expect("it is there");
            for motions in motions.chunks(50) {
                let words = wasm.run(motions).expect("it is finite");
                let samples = session.block_samples() as usize;
                let mut outputs = vec![OutputSample::SILENCE; motions.len() * samples];
                session.play(motions, &mut outputs).expect("it is finite");
                prop_assert!(words.iter().zip(&outputs).all(|(word, output)| *word == output.0));
                prop_assert_eq!(words.len(), outputs.len());
                let floats: Vec<f32> = outputs.iter().map(|o| o.metres_per_second_squared().0).collect();
                prop_assert_eq!(wasm.samples(motions.len()), floats);
                let state = wasm.doubles("state", session.state().len());
                prop_assert_eq!(&state[..], &session.state()[..]);
                prop_assert_eq!(wasm.call("digest", ()), session.digest().0.value());
            }
        }
    }
}

#[test]
fn the_module_plays_the_digest_that_every_platform_plays() {
    let mut wasm = Wasm::with(&digest_library());
    let seed = wasm.call("digest_seed", ());
    assert_eq!(wasm.call("choose_texture", (0, 0, seed, 0)), 0);
    let words = wasm.call("digest_length", ());
    let most = wasm.call("most_blocks", ());
    let mut block = 0;
    while wasm.call("digest_words", ()) < words {
        assert_eq!(wasm.call("digest_motion", (block, most)), 0);
        assert_eq!(wasm.call("run", most), 0, "{}", wasm.text());
        block += most;
    }
    assert_eq!(wasm.call("digest_words", ()), words);
    let digest = wasm.call("digest", ());
    assert_eq!(digest, DIGESTED, "{digest:08x}");
}

#[test]
fn nothing_is_allocated_after_a_library_was_loaded() {
    let library = encode(&kernel_vectors::specs()[..4]).expect("they are lattices");
    let mut wasm = Wasm::with(&library);
    let loaded = wasm.memory_bytes();
    for round in 0..20u32 {
        assert_eq!(wasm.call("choose_texture", (round % 4, 0, round, 0)), 0);
        wasm.run(&[BlockMotion::new(100.0, 1.0); 40]).expect("it is finite");
    }
    assert_eq!(wasm.memory_bytes(), loaded);
}
