//! The kernel's arithmetic on a host. It passes several samples through the stages of a lattice at once, in the
//! processor's vectors, and gives the same bits as the kernel's own [`Portable`].
//!
//! A stage of a lattice needs the result of the previous stage for the same sample, and the result of the stage below
//! for the previous sample. So the stages of one sample cannot be computed in parallel, but several samples can: each
//! sample is two stages behind the previous one, and finds the backward signal that it needs in its neighbour's lane,
//! from the step before. This order of computation is known as a wavefront. No sum changes, so no bit changes.

#[cfg(target_arch = "x86_64")]
mod avx2;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// The arithmetic with the fastest instructions that this processor has and that are supported here; otherwise that of
/// [`Portable`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Wavefront;

/// Instruction sets that have their own arithmetic.
#[derive(Clone, Copy, Debug)]
enum Level {
    /// No special instructions: the kernel's portable arithmetic.
    Scalar,
    /// AVX2 on x86-64.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
}

impl Level {
    /// The fastest level of this processor.
    fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(instructions) = pulp::x86::V3::try_new() {
            return Self::Avx2(instructions);
        }
        Self::Scalar
    }

    /// All levels of this processor, from the slowest to the fastest.
    #[cfg(test)]
    fn all() -> Vec<Self> {
        match Self::best() {
            Self::Scalar => vec![Self::Scalar],
            #[cfg(target_arch = "x86_64")]
            best @ Self::Avx2(_) => vec![Self::Scalar, best],
        }
    }

    /// See [`Arithmetic::rotate_block`].
    fn rotate_block(self, rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
        match self {
            Self::Scalar => Portable::rotate_block(rotations, backward, samples),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(instructions) => {
                avx2::rotate_block(instructions, rotations, backward, samples);
            }
        }
    }
}

impl Arithmetic for Wavefront {
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        Portable::rotate(rotations, backward, forward)
    }

    fn rotate_block(rotations: &[Rotation], backward: &mut [i32], samples: &mut [i32]) {
        Level::best().rotate_block(rotations, backward, samples);
    }
}

/// Compares every level with the kernel's own arithmetic.
#[cfg(test)]
mod tests {
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
}
