//! The normalised lattice: energy and level.

use model_format::SAMPLE_RATE_HZ;
use model_format::limits::MAX_ORDER;
use proptest::prelude::*;
use stylus_hard_cases::energy;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::{Excitation, FRACTION_BITS};
use stylus_kernel::lattice::LatticeState;

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
