//! Interpolation of θ with its fractions, against sums in wider integers.

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER};
use model_format::{CodeSpec, MAX_FINE_THETA, NodeFlags, NodeSpec, Structure};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::Levels;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::LatticeFrame;
use stylus_kernel::rotation::Rotation;

use crate::models::{library, motion, single, texture};

fn node(thetas: &[i32]) -> NodeSpec {
    NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.5,
        flags: NodeFlags::NONE,
        codes: CodeSpec::fine_lattice(thetas),
    }
}

/// Any θ that a library holds, its ends more often than by chance.
fn theta() -> impl Strategy<Value = i32> {
    prop_oneof![
        6 => -MAX_FINE_THETA..=MAX_FINE_THETA,
        1 => Just(MAX_FINE_THETA),
        1 => Just(-MAX_FINE_THETA),
        1 => -300..=300i32,
    ]
}

fn thetas() -> impl Strategy<Value = Vec<i32>> {
    prop_oneof![4 => vec(theta(), 0..60), 1 => vec(theta(), MAX_ORDER)]
}

/// θ as it is stored: all digits of the first stages, and 16 bits of the others.
fn stored(thetas: &[i32]) -> impl Iterator<Item = i32> {
    let rounded = |(stage, &theta): (usize, &i32)| match stage {
        0..MAX_FINE_STAGES => theta,
        _ => (theta + 128).div_euclid(256) * 256,
    };
    thetas.iter().enumerate().map(rounded)
}

fn rotations(bytes: &[u8], speed: f32, force: f32) -> Vec<Rotation> {
    let texture = texture(bytes);
    let mut frame = LatticeFrame::silent(texture.max_order());
    let point = GridPoint::locate(&texture, motion(speed, force));
    frame.update(&texture, &point, Levels::SILENT, 1);
    frame.rotations().to_vec()
}

proptest! {
    #[test]
    fn a_node_is_played_with_all_digits_that_it_stores(thetas in thetas()) {
        let bytes = single(Structure::NormalisedLattice, node(&thetas));
        let expected: Vec<Rotation> = stored(&thetas).map(Rotation::from_theta).collect();
        prop_assert_eq!(rotations(&bytes, 100.0, 1.0), expected);
    }

    #[test]
    fn between_nodes_theta_is_the_weighted_mean_rounded_once(
        nodes in vec(thetas(), 4), speed in 40.0f32..=80.0, force in 0.5f32..=1.0,
    ) {
        let bytes = library(
            Structure::NormalisedLattice, &[40.0, 80.0], &[0.5, 1.0], nodes.iter().map(|thetas| node(thetas)).collect(),
        );
        let point = GridPoint::locate(&texture(&bytes), motion(speed, force));
        let longest = nodes.iter().map(Vec::len).max().unwrap_or(0);
        let mut sums = vec![0i64; longest];
        for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
            for (sum, theta) in sums.iter_mut().zip(stored(&nodes[2 * speed + force])) {
                *sum += i64::from(theta) * i64::from(weight);
            }
        }
        let mean = |sum: i64| (sum + (1 << 15)).div_euclid(1 << 16) as i32;
        let expected: Vec<Rotation> = sums.into_iter().map(mean).map(Rotation::from_theta).collect();
        prop_assert_eq!(rotations(&bytes, speed, force), expected);
    }
}
