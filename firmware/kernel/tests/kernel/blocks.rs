//! Blocks of samples computed ahead of time have the same bits as samples computed one by one.

use model_format::{Library, OutputSample, PartsSpec, TextureSpec, encode, encode_with_scenes};
use proptest::prelude::*;
use stylus_kernel::scene::{Plan, ScenePlayer};
use stylus_kernel::{MAX_FED_SAMPLES, Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::fed::{all_parts, encoded, fed_h3};
use crate::models::{at, lifted, motion, resonant, side_by_side, tap, texture};

/// Strategy of motions. Each moment has a speed, mm/s, a force, N, the samples until the next moment, and the length of
/// the first block.
fn moments() -> impl Strategy<Value = Vec<(f32, f32, u32, usize)>> {
    let samples = prop_oneof![Just(10), 1..=MAX_FED_SAMPLES as u32];
    let speed = prop_oneof![Just(75.0f32), 40.0..120.0f32];
    let force = prop_oneof![Just(0.75f32), 0.3..1.2f32];
    prop::collection::vec((speed, force, samples, 0usize..90), 1..12)
}

/// Plays `samples` + `cut` samples: two blocks by `block`, and then single samples by `single`.
fn in_blocks<P>(
    player: &mut P,
    samples: u32,
    cut: usize,
    block: impl Fn(&mut P, &mut [OutputSample]),
    single: impl Fn(&mut P) -> OutputSample,
) -> Vec<OutputSample> {
    // More samples than a frame holds, as after a late update.
    let mut outputs = vec![OutputSample::SILENCE; samples as usize + cut];
    let (first, rest) = outputs.split_at_mut(cut.min(samples as usize));
    let (second, singles) = rest.split_at_mut(rest.len() - rest.len() / 5);
    block(player, first);
    block(player, second);
    singles.fill_with(|| single(player));
    outputs
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_texture_in_blocks_plays_the_bits_of_single_samples(
        seed: u64,
        which in 0usize..4,
        moments in moments(),
    ) {
        let parts = all_parts().get(which).cloned().unwrap_or(PartsSpec::default());
        let bytes = encoded(fed_h3(parts));
        let mut one: Synthesis<'_> = Synthesis::new(texture(&bytes), seed);
        let mut other = one.clone();
        for (speed, force, samples, cut) in moments {
            one.follow(motion(speed, force), samples);
            other.follow(motion(speed, force), samples);
            let played = in_blocks(&mut other, samples, cut, Synthesis::next_block, Synthesis::next_sample);
            for sample in played {
                prop_assert_eq!(sample, one.next_sample());
            }
            prop_assert_eq!(other.saturations(), one.saturations());
        }
    }

    /// Two surfaces, plain and fed, with a tap, lifts and a transition.
    #[test]
    fn a_scene_in_blocks_plays_the_bits_of_single_samples(
        seed: u64,
        which in (0usize..4, 0usize..4),
        moments in moments(),
        positions in prop::collection::vec(prop_oneof![4 => (60.0..140.0f32).prop_map(Some), 1 => Just(None)], 12),
    ) {
        let of = |name: &str, which: usize| TextureSpec {
            name: name.to_owned(),
            ..fed_h3(all_parts().get(which).cloned().unwrap_or(PartsSpec::default()))
        };
        let textures = [
            resonant("plain", 110.0),
            of("one", which.0),
            of("two", which.1),
        ];
        let bytes = encode_with_scenes(&textures, &[]).expect("valid textures");
        let library = Library::decode(&bytes).expect("a valid library");
        let mut scene = side_by_side(&[1, 2], 20.0);
        scene.surfaces[0].tap = Some(tap(200.0, 0.01));
        let plan = Plan::new(&scene, &library).expect("a valid scene");
        let mut one: ScenePlayer<'_> = ScenePlayer::new(plan, seed);
        let mut other = one.clone();
        for ((speed, force, samples, cut), position) in moments.into_iter().zip(positions) {
            let interaction = position.map_or(lifted(), |position| at(position, motion(speed, force)));
            one.follow(interaction, samples);
            other.follow(interaction, samples);
            let played = in_blocks(&mut other, samples, cut, ScenePlayer::next_block, ScenePlayer::next_sample);
            for sample in played {
                prop_assert_eq!(sample, one.next_sample());
            }
            prop_assert_eq!(other.saturations(), one.saturations());
        }
    }
}

/// The kernel in forty lines.
#[path = "../../examples/forty_lines.rs"]
#[allow(dead_code, reason = "its `main` is not called")]
mod forty_lines;

#[test]
fn forty_lines_play_what_the_kernel_plays_sample_by_sample() {
    let bytes = encode(&[resonant("bell", 110.0)]).unwrap();
    let moving = |sample: usize| motion(50.0 + sample as f32 / 50.0, 1.0);
    let mut played = vec![OutputSample::SILENCE; 5003];
    forty_lines::play(&bytes, moving, &mut played).unwrap();
    let mut synthesis: Synthesis = Synthesis::new(texture(&bytes), 1);
    for (sample, &output) in played.iter().enumerate() {
        if sample % UPDATE_INTERVAL_SAMPLES as usize == 0 {
            let left = (played.len() - sample) as u32;
            synthesis.follow(moving(sample), left.min(UPDATE_INTERVAL_SAMPLES));
        }
        assert_eq!(output, synthesis.next_sample(), "sample {sample}");
    }
    assert!(
        played
            .iter()
            .any(|output| output.0.abs() > 1 << OutputSample::FRACTION_BITS)
    );
    forty_lines::play(&bytes, |_| Motion::REST, &mut played).unwrap();
    assert!(played.iter().all(|&output| output == OutputSample::SILENCE));
    assert!(forty_lines::play(&bytes[..9], |_| Motion::REST, &mut played).is_err());
    let text = include_str!("../../examples/forty_lines.rs");
    let code = text.lines().filter(|line| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with("//")
    });
    assert!(code.count() <= 40);
}
