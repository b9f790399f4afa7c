//! Compares every level with the kernel's own arithmetic.

use model_format::limits::MAX_ORDER;
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::{Rotation, THETA_QUARTER_TURN};

use super::Level;

/// A signal of any size. The extremes, which saturate, occur more often than by chance.
fn signal() -> impl Strategy<Value = i32> {
    prop_oneof![4 => any::<i32>(), 2 => -100..100i32, 2 => Just(i32::MIN), 2 => Just(i32::MAX)]
}

fn theta() -> impl Strategy<Value = i32> {
    let range = -THETA_QUARTER_TURN..=THETA_QUARTER_TURN;
    let ends = [-THETA_QUARTER_TURN, THETA_QUARTER_TURN, 0, THETA_QUARTER_TURN / 2];
    prop_oneof![4 => range, 2 => -9000..9000i32, 2 => prop::sample::select(ends.to_vec())]
}

fn order() -> impl Strategy<Value = usize> {
    prop_oneof![0usize..40, 0..=MAX_ORDER, Just(MAX_ORDER)]
}

/// The outputs and the state after them, computed one sample after the other.
fn one_by_one(rotations: &[Rotation], backward: &[i32], samples: &[i32]) -> (Vec<i32>, Vec<i32>) {
    let mut backward = backward.to_vec();
    let outputs = samples.iter().map(|&sample| {
        let output = Portable::rotate(rotations, &mut backward, sample);
        backward[0] = output;
        output
    });
    (outputs.collect(), backward)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn a_block_in_any_cut_gives_the_bits_of_single_samples(
        thetas in order().prop_flat_map(|order| vec(theta(), order)),
        pool in vec(signal(), MAX_ORDER + 1),
        samples in vec(signal(), 0..120),
        cuts in vec(1usize..40, 1..8),
    ) {
        let rotations: Vec<Rotation> = thetas.into_iter().map(Rotation::from_theta).collect();
        let start = &pool[..=rotations.len()];
        let (outputs, state) = one_by_one(&rotations, start, &samples);
        for level in Level::all() {
            let (mut played, mut backward) = (samples.clone(), start.to_vec());
            let (mut rest, mut lengths) = (&mut played[..], cuts.iter().cycle());
            while !rest.is_empty() {
                let cut = rest.len().min(*lengths.next().expect("a cycle has no end"));
                let (block, after) = rest.split_at_mut(cut);
                level.rotate_block(&rotations, &mut backward, block);
                rest = after;
            }
            prop_assert_eq!(&played, &outputs, "{:?}", level);
            prop_assert_eq!(&backward, &state, "{:?}", level);
        }
    }
}

/// Covers every width of a pass in every short lattice, in which samples begin while others end, with saturation at
/// each end.
#[test]
fn all_short_lattices_and_all_short_blocks_give_the_bits_of_single_samples() {
    for order in 0..=70 {
        let rotations: Vec<Rotation> = (0..order)
            .map(|stage| (stage * 2_654_435 % 16_777_216) - THETA_QUARTER_TURN)
            .map(Rotation::from_theta)
            .collect();
        let words = |seed: i32, count: usize| {
            let full = [i32::MAX, i32::MIN, 0];
            let word = |index: usize| match index % 5 {
                place @ 0..3 => full[place],
                _ => (index as i32 + 1).wrapping_mul(seed),
            };
            (0..count).map(word).collect::<Vec<i32>>()
        };
        let start = words(1_640_531_527, rotations.len() + 1);
        for count in 0..=35 {
            let samples = words(-1_028_477_387, count);
            let (outputs, state) = one_by_one(&rotations, &start, &samples);
            for level in Level::all() {
                let (mut played, mut backward) = (samples.clone(), start.clone());
                level.rotate_block(&rotations, &mut backward, &mut played);
                assert_eq!(
                    (&played, &backward),
                    (&outputs, &state),
                    "{level:?}, {order} stages, {count} samples"
                );
            }
        }
    }
}
