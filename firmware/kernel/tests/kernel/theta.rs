//! Interpolation of θ with its fractions, compared with sums in wider integers.

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER};
use model_format::{CodeSpec, FINE_THETA_STEP_RAD, MAX_FINE_THETA, NodeSpec};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::Levels;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::lattice::LatticeFrame;
use stylus_kernel::rotation::{Rotation, SUM_PER_THETA, SUM_QUARTER_TURN};
use stylus_kernel::theta::BIAS;

use crate::models::{library, motion, single, texture};

fn node(thetas: &[i32]) -> NodeSpec {
    node_of(CodeSpec::fine_lattice(thetas))
}

fn node_of(codes: CodeSpec) -> NodeSpec {
    NodeSpec::new(1.0, codes)
}

/// Any θ that a library holds; the ends of the range are more frequent than by chance.
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

/// θ as it is stored: all digits of the first stages, and 16 bits of the other stages.
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
    frame.update::<Portable>(&texture, &point, Levels::SILENT, 1);
    frame.rotations().to_vec()
}

/// A texture with the lattices `nodes` at the corners of one cell, 40 to 80 mm/s and 0.5 to 1 N.
fn square(nodes: Vec<NodeSpec>) -> Vec<u8> {
    library(&[40.0, 80.0], &[0.5, 1.0], nodes)
}

fn longest(nodes: &[Vec<i32>]) -> usize {
    nodes.iter().map(Vec::len).max().unwrap_or(0)
}

proptest! {
    #[test]
    fn a_node_is_played_with_all_digits_that_it_stores(thetas in thetas()) {
        let bytes = single(node(&thetas));
        let expected: Vec<Rotation> = stored(&thetas).map(Rotation::from_theta).collect();
        prop_assert_eq!(rotations(&bytes, 100.0, 1.0), expected);
    }

    /// Each product of a weight with a code or a fraction is rounded down separately. The start is chosen so that the
    /// sum is right after its last three digits are dropped.
    #[test]
    fn between_nodes_theta_is_the_sum_of_truncated_products(
        nodes in vec(thetas(), 4), speed in 40.0f32..=80.0, force in 0.5f32..=1.0,
    ) {
        let bytes = square(nodes.iter().map(|thetas| node(thetas)).collect());
        let point = GridPoint::locate(&texture(&bytes), motion(speed, force));
        let mut sums = vec![0i64; longest(&nodes)];
        for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
            for (sum, theta) in sums.iter_mut().zip(stored(&nodes[2 * speed + force])) {
                let (code, fraction) = ((theta + 128).div_euclid(256), (theta + 128).rem_euclid(256) - 128);
                for steps in [256 * code, fraction] {
                    let product = i64::from(steps) * i64::from(SUM_PER_THETA) * i64::from(weight);
                    *sum += product.div_euclid(1 << 16);
                }
            }
        }
        let expected: Vec<Rotation> = sums.into_iter().map(|sum| Rotation::from_sum(sum as i32 + BIAS)).collect();
        prop_assert_eq!(rotations(&bytes, speed, force), expected);
    }

    /// Nodes whose tails differ in length and step, including nodes without a tail. The sum is within 8 steps, each 5.6
    /// steps of 2⁻³¹. The rotation adds an error of 4 steps of 2⁻³¹.
    #[test]
    fn sine_and_cosine_are_those_of_the_weighted_mean_with_tails_too(
        nodes in vec((thetas(), 0u32..20), 4), speed in 40.0f32..=80.0, force in 0.5f32..=1.0,
    ) {
        let nodes: Vec<CodeSpec> = nodes
            .into_iter()
            .map(|(thetas, scale)| {
                let scaled = thetas.iter().enumerate().map(|(stage, theta)| match stage {
                    0..MAX_FINE_STAGES => *theta,
                    _ => theta >> scale,
                });
                CodeSpec::compact_lattice(&scaled.collect::<Vec<_>>(), MAX_FINE_STAGES)
            })
            .collect();
        let bytes = square(nodes.iter().cloned().map(node_of).collect());
        let thetas: Vec<Vec<i32>> = nodes.iter().map(|codes| codes.thetas().collect()).collect();
        is_within_steps_of_the_mean(&bytes, &thetas, speed, force)?;
        let single = single(node_of(nodes[0].clone()));
        let expected: Vec<Rotation> = nodes[0].thetas().map(Rotation::from_theta).collect();
        prop_assert_eq!(rotations(&single, 100.0, 1.0), expected);
    }
}

/// Compares the rotations of a motion on a [`square`] of nodes of these θ with sine and cosine of the exact mean.
fn is_within_steps_of_the_mean(bytes: &[u8], nodes: &[Vec<i32>], speed: f32, force: f32) -> Result<(), TestCaseError> {
    let point = GridPoint::locate(&texture(bytes), motion(speed, force));
    let mut angles = vec![0.0; longest(nodes)];
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        for (angle, &theta) in angles.iter_mut().zip(&nodes[2 * speed + force]) {
            *angle += f64::from(theta) * FINE_THETA_STEP_RAD * f64::from(weight) / f64::from(ONE);
        }
    }
    let step = std::f64::consts::FRAC_PI_2 / f64::from(SUM_QUARTER_TURN) * 2f64.powi(31);
    for (rotation, angle) in rotations(bytes, speed, force).into_iter().zip(angles) {
        for (found, exact) in [(rotation.sin, angle.sin()), (rotation.cos, angle.cos())] {
            let error = f64::from(found) - exact * 2f64.powi(31);
            prop_assert!(error.abs() <= 8.0 * step + 4.0, "{error} at {angle}");
        }
    }
    Ok(())
}
