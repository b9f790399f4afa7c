//! The lattice comes to rest: exactly, permanently, and in bounded time.
//!
//! *Proved.* cos² + sin² ≤ 2⁶² with both below 2³¹ means cos² + sin² < 2⁶², because 4³¹ is a sum of two squares in only
//! one way. Each stage whose signals are not zero therefore loses energy. It loses at least 4, because after one sample
//! all signals are even (except a saturated one, which has lost more). Every g[m] that is not zero goes through one
//! stage per sample. So without excitation the energy falls by at least four times their number per sample, and silence
//! comes in the end.
//!
//! *Measured.* This bound is on energy; the time that it implies is far too long. On average, truncation takes 1 from
//! each signal at each stage. With all |k| at 0.9999, where the coefficients would let the lattice ring for very long
//! without truncation, states of magnitude A were silent after A samples or less (0.71 A for random coefficients, 0.999
//! A for the worst pattern found, orders 1 to 400, A from 2¹⁰ to 2¹⁷). Real models lose their energy even without
//! truncation: with every signal at full scale the fixtures were silent after 560 (H3) to 3020 samples (H1b).

use model_format::limits::MAX_ORDER;
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_hard_cases::energy;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::Rotation;

use crate::lattice::{sample, state, theta_code};
use crate::models::rotation;

/// θ of |k| = 0.9999 in steps of π/65 536, rounded down.
const THETA_OF_0_9999: i16 = 32_472;

/// Number of samples without excitation until the state is zero, counted up to `limit`.
fn samples_to_silence(state: &mut LatticeState, rotations: &[Rotation], limit: usize) -> Option<usize> {
    (0..limit).find(|_| {
        let silent = state.is_silent(rotations.len());
        state.filter::<Portable>(rotations, 0);
        silent
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn without_excitation_every_signal_loses_energy_at_every_sample(
        codes in vec(theta_code(), 1..=MAX_ORDER), backward in vec(sample(), MAX_ORDER),
    ) {
        let rotations: Vec<Rotation> = codes.into_iter().map(rotation).collect();
        let order = rotations.len();
        let mut state = state(&backward);
        state.filter::<Portable>(&rotations, 0);
        for _ in 0..40 {
            let before = energy(state.backward(order));
            let sounding = state.backward(order).iter().filter(|&&g| g != 0 && g != i32::MAX).count();
            state.filter::<Portable>(&rotations, 0);
            prop_assert!(energy(state.backward(order)) + 4 * sounding as u128 <= before);
        }
    }

    /// The bound is twice the worst measured time, plus the time that a sample takes through the stages.
    #[test]
    fn silence_comes_within_twice_as_many_samples_as_the_largest_signal_has_steps(
        codes in prop_oneof![
            9 => vec(-THETA_OF_0_9999..=THETA_OF_0_9999, 1..=60),
            // A single magnitude in all stages is worse than random ones.
            9 => (1..=60usize, 0..=THETA_OF_0_9999, any::<bool>()).prop_map(|(order, theta, alternating)| {
                (0..order).map(|stage| if alternating && stage % 2 == 1 { -theta } else { theta }).collect()
            }),
            1 => vec(-THETA_OF_0_9999..=THETA_OF_0_9999, MAX_ORDER),
        ],
        (largest, backward) in (1i32..2048)
            .prop_flat_map(|largest| (Just(largest), vec(-largest..=largest, MAX_ORDER))),
    ) {
        let rotations: Vec<Rotation> = codes.into_iter().map(rotation).collect();
        let mut state = state(&backward);
        let limit = 2 * largest as usize + rotations.len();
        prop_assert!(samples_to_silence(&mut state, &rotations, limit).is_some());
        prop_assert!(state.is_silent(rotations.len()));
    }
}
