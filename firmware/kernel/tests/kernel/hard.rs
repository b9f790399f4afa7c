//! Grids, motions and states of any kind together: the lattice keeps its promises for all combinations.

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER, MAX_OUTPUT_POWER};
use model_format::{CodeSpec, FadeLaw, Laws, LevelLaw, NodeFlags, NodeSpec, PartsSpec, TailSpec, TextureSpec, encode};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use stylus_hard_cases::energy;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::LatticeFrame;
use stylus_kernel::{Levels, Motion, Synthesis};

use crate::lattice::{sample, state, theta_code};
use crate::models::{motion, spec, texture};

/// A node of any order and level, including silent ones.
fn node() -> impl Strategy<Value = NodeSpec> {
    let codes = prop_oneof![6 => vec(theta_code(), 0..40), 1 => vec(theta_code(), MAX_ORDER), 1 => Just(Vec::new())];
    let fractions = prop_oneof![1 => Just(Vec::new()), 2 => vec(any::<i8>(), 0..=MAX_FINE_STAGES)];
    let power = prop_oneof![
        Just(MAX_OUTPUT_POWER),
        Just(f32::MIN_POSITIVE),
        1e-9f32..MAX_OUTPUT_POWER
    ];
    prop_oneof![
        8 => (codes, fractions, power).prop_map(|(codes, mut fractions, output_power)| NodeSpec::new(output_power, {
                fractions.truncate(codes.len());
                CodeSpec { codes, fractions, tail: TailSpec::default() }
            })),
        1 => Just(NodeSpec::silent()),
    ]
}

/// The same nodes with one byte per stage after the first 32, in steps of `step` if that node allows more than one.
fn with_tails(mut nodes: Vec<NodeSpec>, step: u16) -> Vec<NodeSpec> {
    for node in &mut nodes {
        let thetas: Vec<i32> = node.codes.thetas().collect();
        node.codes = CodeSpec::compact_lattice(&thetas, MAX_FINE_STAGES);
        if node.codes.tail.step > 1 {
            node.codes.tail.step = step;
        }
    }
    nodes
}

/// A library of 3 x 2 such nodes, with laws that these nodes allow.
fn grid() -> impl Strategy<Value = Vec<u8>> {
    let laws = (select(&LevelLaw::ALL[..]), select(&FadeLaw::ALL[..]));
    let step = prop_oneof![Just(1), Just(u16::MAX), 1..=u16::MAX];
    let tails = proptest::option::of(step);
    (vec(node(), 6), laws, tails).prop_map(|(nodes, (level, fade), tails)| {
        let nodes = match tails {
            Some(step) => with_tails(nodes, step),
            None => nodes,
        };
        let silent = |node: &NodeSpec| node.flags.contains(NodeFlags::SILENT);
        let level = match level {
            LevelLaw::Logarithm if nodes.iter().any(silent) => LevelLaw::Amplitude,
            level => level,
        };
        let speeds = [40.0, 80.0, 160.0];
        let spec = TextureSpec {
            laws: Laws { level, fade },
            parts: PartsSpec::default(),
            ..spec(&speeds, &[0.5, 1.5], nodes)
        };
        encode(&[spec]).expect("a valid library")
    })
}

/// A motion on a node, between nodes, at the edges, beyond, or at rest.
fn any_motion() -> impl Strategy<Value = Motion> {
    let speed = prop_oneof![6 => 0.0f32..250.0, 1 => Just(0.0), 1 => Just(80.0), 1 => -f32::MAX..=f32::MAX];
    let force = prop_oneof![6 => 0.0f32..2.0, 1 => Just(0.0), 1 => Just(1.5), 1 => -f32::MAX..=f32::MAX];
    (speed, force).prop_map(|(speed, force)| motion(speed, force))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn no_grid_motion_or_state_lets_energy_grow(
        bytes in grid(),
        backward in vec(sample(), MAX_ORDER),
        steps in vec((any_motion(), prop_oneof![1 => Just(0), 1 => sample()]), 1..60),
    ) {
        let texture = texture(&bytes);
        let mut frame = LatticeFrame::silent(texture.max_order());
        let mut state = state(&backward);
        for (motion, excitation) in steps {
            frame.update::<Portable>(&texture, &GridPoint::locate(&texture, motion), Levels::SILENT, 1);
            let stages = frame.rotations().len();
            let before = energy(state.backward(stages)) + energy(&[excitation]);
            let (output, at_full_scale) = state.next_sample::<Portable>(&frame, excitation, 0);
            prop_assert!(energy(state.backward(stages)) <= before);
            // No output exceeds the lattice's full scale times the gain of the loudest node.
            let most = f64::from(texture.max_output_power()).sqrt() * 8.0;
            prop_assert!(f64::from(output.metres_per_second_squared().0).abs() <= most * 1.000_001);
            let newest = if stages == 0 { excitation } else { state.backward(1)[0] };
            prop_assert_eq!(at_full_scale, newest == i32::MAX || newest == i32::MIN);
        }
    }

    /// At rest the level is zero at once, whatever the state and the earlier motion.
    #[test]
    fn any_motion_ends_in_silence_at_rest(bytes in grid(), motions in vec(any_motion(), 1..40), seed: u64) {
        let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), seed);
        for motion in motions {
            synthesis.follow(motion, 1);
            synthesis.next_sample();
        }
        synthesis.follow(Motion::REST, 1);
        for _ in 0..20 {
            prop_assert_eq!(synthesis.next_sample().0, 0);
        }
    }
}
