//! Weights and fades for every motion on every grid.

use model_format::{NodeSpec, Texture};
use proptest::collection::btree_set;
use proptest::prelude::*;
use stylus_kernel::Motion;
use stylus_kernel::grid::{GridPoint, ONE};

use crate::models::{library, motion, texture};

/// Axes of any length, with values from those of hands and hardware to the extremes of the type.
fn axis() -> impl Strategy<Value = Vec<f32>> {
    let value = prop_oneof![
        4 => (1u32..10_000).prop_map(|value| (value as f32 / 10.0).to_bits()),
        1 => Just(0.0f32.to_bits()),
        1 => 0..=f32::MAX.to_bits(),
    ];
    btree_set(value, 1..=6).prop_map(|bits| bits.into_iter().map(f32::from_bits).collect())
}

/// A library of silent nodes. The position of a motion on its grid does not depend on models.
fn grid(speeds: &[f32], forces: &[f32]) -> Vec<u8> {
    let nodes = vec![NodeSpec::silent(); speeds.len() * forces.len()];
    library(speeds, forces, nodes)
}

/// A value anywhere around `axis`: in a cell, on a node or next to one, below, above, or any finite number.
fn value_about(axis: &[f32], choice: (u8, f32, u32)) -> f32 {
    let (kind, share, bits) = choice;
    let node = axis[bits as usize % axis.len()];
    match kind % 8 {
        0 => 0.0,
        1 => node,
        2 => node.next_up().min(f32::MAX),
        3 => node.next_down().max(0.0),
        4 => axis[0] * share,
        5 => f32::from_bits(bits % (f32::MAX.to_bits() + 1)),
        _ => {
            let (first, last) = (axis[0], axis[axis.len() - 1]);
            (first + (last - first) * share).clamp(first, last)
        }
    }
}

fn choice() -> impl Strategy<Value = (u8, f32, u32)> {
    (any::<u8>(), 0.0f32..=1.0, any::<u32>())
}

/// Mean of a quantity over the nodes with the weights of `point`, times [`ONE`].
fn weighted(point: &GridPoint, quantity: impl Fn(usize, usize) -> f64) -> f64 {
    point
        .nodes
        .iter()
        .zip(&point.weights)
        .map(|(&(speed, force), &weight)| quantity(speed, force) * f64::from(weight))
        .sum()
}

/// `value` clamped to the axis, and the width of its cell.
fn clamped(axis: &[f32], value: f32) -> (f64, f64) {
    let value = value.clamp(axis[0], axis[axis.len() - 1]);
    let above = axis.iter().position(|&node| node > value).unwrap_or(axis.len() - 1);
    let width = f64::from(axis[above]) - f64::from(axis[above.saturating_sub(1)]);
    (f64::from(value), width)
}

fn locate(texture: &Texture<'_>, speed: f32, force: f32) -> GridPoint {
    GridPoint::locate(texture, motion(speed, force))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2048))]

    #[test]
    fn weights_add_up_to_one_and_reproduce_the_motion_itself(
        (speeds, forces) in (axis(), axis()), speed in choice(), force in choice(),
    ) {
        let bytes = grid(&speeds, &forces);
        let texture = texture(&bytes);
        let (speed, force) = (value_about(&speeds, speed), value_about(&forces, force));
        let point = locate(&texture, speed, force);
        prop_assert_eq!(point.weights.iter().map(|&weight| u64::from(weight)).sum::<u64>(), u64::from(ONE));
        for (at, &(s, f)) in point.nodes.iter().enumerate() {
            prop_assert!(s < speeds.len() && f < forces.len());
            let doubled = point.nodes[..at].contains(&(s, f));
            prop_assert!(!doubled || point.weights[at] == 0);
        }
        // An affine function of speed and force is reproduced: the sum of weights gives the constant, the weights give
        // the rest.
        let one = f64::from(ONE);
        let (exact, width) = clamped(&speeds, speed);
        let mean = weighted(&point, |s, _| f64::from(speeds[s]));
        prop_assert!((mean - exact * one).abs() <= 2.0 * width + 1e-9 * mean, "speed {} {}", mean / one, exact);
        let (exact, width) = clamped(&forces, force);
        let mean = weighted(&point, |_, f| f64::from(forces[f]));
        prop_assert!((mean - exact * one).abs() <= 2.0 * width + 1e-9 * mean, "force {} {}", mean / one, exact);
    }

    #[test]
    fn above_the_grid_its_edge_counts(
        (speeds, forces) in (axis(), axis()), beyond in 1.0f32..10.0, force in choice(),
    ) {
        let bytes = grid(&speeds, &forces);
        let texture = texture(&bytes);
        let last = speeds[speeds.len() - 1];
        let force = value_about(&forces, force);
        let above = (last * beyond).clamp(f32::MIN_POSITIVE, f32::MAX);
        let at = |speed| weighted(&locate(&texture, speed, force), |s, f| (64 * s + f) as f64);
        prop_assert_eq!(at(above).to_bits(), at(last).to_bits());
        prop_assert_eq!(locate(&texture, above, force).fade, locate(&texture, last.max(f32::MIN_POSITIVE), force).fade);
    }

    #[test]
    fn a_speed_counts_by_its_magnitude_and_a_negative_force_is_no_contact(
        (speeds, forces) in (axis(), axis()), speed in choice(), force in choice(),
    ) {
        let bytes = grid(&speeds, &forces);
        let texture = texture(&bytes);
        let (speed, force) = (value_about(&speeds, speed), value_about(&forces, force));
        prop_assert_eq!(locate(&texture, -speed, force), locate(&texture, speed, force));
        prop_assert_eq!(motion(speed, -force), motion(speed, 0.0));
        prop_assert_eq!(motion(-0.0, -0.0), Motion::REST);
        prop_assert_eq!(locate(&texture, speed, -force).fade, 0);
    }
}
