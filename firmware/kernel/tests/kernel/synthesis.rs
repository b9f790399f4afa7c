//! A texture being played: starting, stopping, moving, repeating.

use model_format::limits::MAX_OUTPUT_POWER;
use model_format::{CodeSpec, NodeSpec, OutputSample};
use proptest::prelude::*;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::grid::ONE;
use stylus_kernel::{Frame, Levels, Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::models::{fixture, library, motion, single, texture};

/// 2 × 2 nodes of different power.
fn smooth(power: f32) -> Vec<u8> {
    let node = |share: f32| fixture("H1b").node(power * share);
    let nodes = vec![node(0.25), node(0.5), node(0.5), node(1.0)];
    library(&[50.0, 100.0], &[0.5, 1.0], nodes)
}

fn play<'a>(synthesis: &'a mut Synthesis<'_>, motion: Motion, samples: u32) -> impl Iterator<Item = OutputSample> + 'a {
    synthesis.follow(motion, samples);
    (0..samples).map(|_| synthesis.next_sample())
}

#[test]
fn before_any_motion_there_is_exact_silence() {
    let bytes = smooth(MAX_OUTPUT_POWER);
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 1);
    assert!((0..1000).all(|_| synthesis.next_sample() == OutputSample::SILENCE));
    assert_eq!(synthesis.saturations(), 0);
}

proptest! {
    /// Compared with the same noise at its full level from the first sample on. The first sample may exceed a tenth of
    /// that level by ten output steps at most: one for rounding, and nine for the steps of the ramp, which are
    /// truncated.
    #[test]
    fn the_first_sample_has_a_tenth_of_the_level_at_most(seed: u64, power in 0.0f32..MAX_OUTPUT_POWER) {
        let bytes = smooth(power.max(f32::MIN_POSITIVE));
        let at_once = Synthesis::new(texture(&bytes), seed);
        let mut ramped: Synthesis<'_> = at_once.clone();
        let mut at_once: Synthesis<'_> = at_once;
        let moving = motion(75.0, 0.75);
        let full = play(&mut at_once, moving, 1).next().expect("one sample");
        let first = play(&mut ramped, moving, UPDATE_INTERVAL_SAMPLES).next().expect("one sample");
        let (full, first) = (i64::from(full.0).abs(), i64::from(first.0).abs());
        prop_assert!(10 * first <= full + 1 + 10 * 10, "{} of {}", first, full);
    }
}

proptest! {
    /// Compared with the same noise at full level. The output of a model of order 0 is its excitation times the level.
    #[test]
    fn a_motion_that_comes_before_the_level_is_there_goes_on_from_the_level_of_the_moment(
        seed: u64, played in 1u32..UPDATE_INTERVAL_SAMPLES,
    ) {
        let node = NodeSpec::new(MAX_OUTPUT_POWER, CodeSpec::lattice(Vec::new()));
        let bytes = single(node);
        let moving = motion(75.0, 0.75);
        let mut full: Synthesis<'_> = Synthesis::new(texture(&bytes), seed);
        full.follow(moving, 1);
        let mut interrupted: Synthesis<'_> = Synthesis::new(texture(&bytes), seed);
        let mut shares = Vec::new();
        for samples in [played, UPDATE_INTERVAL_SAMPLES] {
            interrupted.follow(moving, UPDATE_INTERVAL_SAMPLES);
            for _ in 0..samples {
                let (full, output) = (full.next_sample().0, interrupted.next_sample().0);
                // A relative error is meaningless where the noise is near zero.
                if full.abs() > 1 << 20 {
                    shares.push(f64::from(output) / f64::from(full));
                }
            }
        }
        for pair in shares.windows(2) {
            prop_assert!(pair[1] >= pair[0] - 1e-5, "the level falls from {} to {}", pair[0], pair[1]);
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_samples_and_a_copy_goes_on_alike() {
    let motions = || (0..200u16).map(|n| motion(f32::from(n), f32::from(n % 37) / 20.0));
    let bytes = smooth(4.0);
    let begin = |seed| -> Synthesis<'_> { Synthesis::new(texture(&bytes), seed) };
    let (mut one, mut same, mut other) = (begin(7), begin(7), begin(8));
    let (mut played, mut played_other) = (Vec::new(), Vec::new());
    for (n, motion) in motions().enumerate() {
        let mut copy = one.clone();
        let from = played.len();
        played.extend(play(&mut one, motion, UPDATE_INTERVAL_SAMPLES));
        assert!(play(&mut same, motion, UPDATE_INTERVAL_SAMPLES).eq(played[from..].iter().copied()));
        assert!(
            play(&mut copy, motion, UPDATE_INTERVAL_SAMPLES).eq(played[from..].iter().copied()),
            "{n}"
        );
        played_other.extend(play(&mut other, motion, UPDATE_INTERVAL_SAMPLES));
    }
    assert_ne!(played, played_other);
}

/// Earlier frames leave a trace only in the filter's state, neither in coefficients nor in levels.
#[test]
fn a_motion_calls_for_the_same_whatever_the_motion_before() {
    let nodes = ["H1b", "H2b", "H1b", "H2b", "H1b", "H2b"].map(|name| fixture(name).node(1.0));
    let bytes = library(&[50.0, 100.0, 150.0], &[0.5, 1.0], nodes.to_vec());
    let end = motion(60.0, 0.55);
    let mut straight: Synthesis<'_> = Synthesis::new(texture(&bytes), 9);
    straight.follow(end, 1);
    let expected: Vec<_> = (0..=100).map(|_| straight.next_sample()).collect();
    for before in [
        motion(140.0, 0.9),
        motion(100.0, 0.5),
        motion(900.0, 9.0),
        motion(10.0, 0.1),
    ] {
        let mut moved: Synthesis<'_> = Synthesis::new(texture(&bytes), 9);
        moved.follow(end, 1);
        moved.follow(before, 1);
        moved.follow(end, 1);
        assert!((0..=100).map(|_| moved.next_sample()).eq(expected.iter().copied()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A held frame equals one that is updated again with the same motion, at any point of its ramps.
    #[test]
    fn holding_a_motion_gives_the_bits_of_another_update(
        speed in 0.0f32..200.0, force in 0.0f32..1.5, gain in 0u32..=ONE, left in 0u32..10, samples in 1u32..20,
    ) {
        let nodes = ["H1b", "H2b", "H3", "H1a"].map(|name| fixture(name).node(4.0));
        let bytes = library(&[50.0, 150.0], &[0.5, 1.0], nodes.to_vec());
        let texture = texture(&bytes);
        let (mut held, moving) = (Frame::silent(&texture), motion(speed, force));
        held.update_scaled::<Portable>(&texture, motion(90.0, 0.7), ONE, Levels::SILENT, 10);
        held.update_scaled::<Portable>(&texture, moving, gain, held.levels(0), 10);
        let mut updated = held.clone();
        let from = held.levels(left);
        held.hold(from, samples);
        updated.update_scaled::<Portable>(&texture, moving, gain, from, samples);
        prop_assert_eq!(format!("{held:?}"), format!("{updated:?}"));
    }
}
