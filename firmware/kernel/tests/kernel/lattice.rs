//! The normalised lattice: its energy and level, and that it comes to rest: exactly, permanently, and in bounded time.
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

use model_format::SAMPLE_RATE_HZ;
use model_format::limits::MAX_ORDER;
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_hard_cases::energy;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::{Excitation, FRACTION_BITS};
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::Rotation;

use crate::models::{fixtures, rotation};

/// A sample of any size; the extremes are more frequent than by chance.
pub fn sample() -> impl Strategy<Value = i32> {
    prop_oneof![6 => any::<i32>(), 2 => -100..100i32, 1 => Just(i32::MIN), 1 => Just(i32::MAX)]
}

/// A θ code that a valid library may have.
pub fn theta_code() -> impl Strategy<Value = i16> {
    prop_oneof![6 => -i16::MAX..=i16::MAX, 1 => Just(-i16::MAX), 1 => Just(i16::MAX), 1 => -3..=3i16]
}

pub fn state(backward: &[i32]) -> LatticeState {
    let mut all = [0; MAX_ORDER];
    all[..backward.len()].copy_from_slice(backward);
    LatticeState::from_backward(all)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// In a long lattice the truncation in one stage could hide a gain in another, so each stage is tested separately.
    #[test]
    fn one_stage_is_its_rotation_never_longer_truncated_and_saturated(
        code in theta_code(), f in sample(), g in sample(),
    ) {
        let rotation = rotation(code);
        let mut state = state(&[g]);
        state.filter::<Portable>(&[rotation], f);
        let turned = state.backward(2);
        prop_assert!(energy(turned) <= energy(&[f, g]));
        let (cos, sin) = (i128::from(rotation.cos), i128::from(rotation.sin));
        let (f, g) = (i128::from(f), i128::from(g));
        for (&actual, exact) in turned.iter().zip([cos * f - sin * g, sin * f + cos * g]) {
            let (actual, full_scale) = (i128::from(actual), 1i128 << 31);
            let saturated = exact.clamp(-full_scale << 31, (full_scale - 1) << 31);
            // The error is toward zero and at most two steps, because halves are truncated before they are doubled.
            prop_assert!((actual << 31).abs() <= saturated.abs());
            prop_assert!(((actual << 31) - saturated).abs() <= 2 << 31);
        }
    }
}

const DEVIATION: f64 = (1u32 << FRACTION_BITS) as f64;

/// The standard deviation of a power that is estimated over 60 s is up to 0.08 dB for the narrowest of these lines.
#[test]
fn output_and_backward_signals_have_the_power_of_the_excitation() {
    const SAMPLES: u32 = 60 * SAMPLE_RATE_HZ;
    for model in fixtures() {
        let rotations = model.rotations();
        let (mut state, mut noise) = (LatticeState::new(), Excitation::new(1));
        let mut output_power = 0.0;
        let mut powers = vec![0.0; MAX_ORDER];
        for n in 0..SAMPLES {
            let output = f64::from(state.filter::<Portable>(&rotations, noise.next_sample())) / DEVIATION;
            output_power += output * output;
            if n % 10 == 0 {
                for (power, &g) in powers.iter_mut().zip(state.backward(MAX_ORDER)) {
                    *power += (f64::from(g) / DEVIATION).powi(2);
                }
            }
        }
        let level_db = 10.0 * (output_power / f64::from(SAMPLES)).log10();
        assert!(level_db.abs() < 0.2, "{}: level {level_db} dB", model.name);
        for (stage, power) in powers.iter().enumerate() {
            let level_db = 10.0 * (power / f64::from(SAMPLES / 10)).log10();
            assert!(level_db.abs() < 0.4, "{}, g[{stage}]: level {level_db} dB", model.name);
        }
    }
}

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

/// Every signal begins at full scale, with a random sign.
#[test]
fn models_of_order_400_are_silent_within_a_second_after_the_loudest_state() {
    for model in fixtures() {
        let rotations = model.rotations();
        let mut longest = 0;
        for seed in 0..8 {
            let mut noise = Excitation::new(seed);
            let full_scale = |_| {
                if noise.next_sample() < 0 { i32::MIN } else { i32::MAX }
            };
            let mut state = state(&(0..MAX_ORDER).map(full_scale).collect::<Vec<_>>());
            let samples = samples_to_silence(&mut state, &rotations, 5000);
            longest = longest.max(samples.unwrap_or_else(|| panic!("{} still sounds", model.name)));
        }
        println!("{}: silent after {longest} samples at most", model.name);
    }
}
