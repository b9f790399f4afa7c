//! The player and its filter, compared with the product's synthesis and with wider integers.

use model_format::{CodeSpec, Library, MillimetresPerSecond, Newton, NodeSpec, TextureSpec, encode};
use proptest::prelude::*;
use stylus_hard_cases::{Filter, Lattice, any_at_end, energy, fixtures};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::{Motion, Synthesis};

/// The stressed filter and the played one give the same bits.
#[test]
fn a_lattice_and_a_synthesis_play_the_same() {
    let models = fixtures();
    let node = |index: usize| {
        let code = |k: &f64| (k.asin() / model_format::THETA_STEP_RAD).round() as i16;
        let codes = models[index].reflection.iter().map(code).collect();
        NodeSpec::new(4.0, CodeSpec::lattice(codes))
    };
    let nodes = [0, 1, 3, 0].map(node).to_vec();
    let spec = TextureSpec::new("hard", &[100.0, 200.0], &[0.5, 1.0], nodes);
    let bytes = encode(&[spec]).unwrap();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let mut synthesis: Synthesis<'_> = Synthesis::from_rest(texture, 5);
    let mut lattice = Lattice::<Portable>::new(&texture);
    let (mut noise, mut left) = (Excitation::new(5), 0);
    for n in 0..2000u16 {
        let speed = MillimetresPerSecond(f32::from(n % 97) * 3.0);
        let motion = Motion::new(speed, Newton(f32::from(n % 31) / 25.0)).unwrap();
        // In one sample, and in ramps that are cut short.
        let samples = if n < 1000 { 1 } else { 10 };
        synthesis.follow(motion, samples);
        lattice.follow(&texture, motion, left, samples);
        left = samples;
        for _ in 0..samples.min(7) {
            left -= 1;
            let played = lattice.sample(noise.next_sample(), left).0;
            assert_eq!(played, synthesis.next_sample(), "step {n}");
        }
    }
}

proptest! {
    #[test]
    fn energy_is_the_exact_sum_of_squares_and_ends_are_found(
        signals in prop::collection::vec(prop_oneof![any::<i32>(), Just(i32::MIN), Just(i32::MAX)], 0..800),
    ) {
        let exact: u128 = signals.iter().map(|&signal| u128::from(signal.unsigned_abs()).pow(2)).sum();
        prop_assert_eq!(energy(&signals), exact);
        let at_end = signals.iter().any(|&signal| signal == i32::MIN || signal == i32::MAX);
        prop_assert_eq!(any_at_end(&signals), at_end);
    }
}
