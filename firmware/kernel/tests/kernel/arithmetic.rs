//! The sums of products against integers that cannot overflow.

use proptest::prelude::*;
use stylus_kernel::arithmetic::{Arithmetic, Portable, SUMS, TURN_TAPS, Turn};

fn word() -> impl Strategy<Value = i32> {
    prop_oneof![3 => any::<i32>(), 1 => Just(i32::MIN), 1 => Just(i32::MAX), 1 => -1i32..=1]
}

fn turn() -> impl Strategy<Value = Turn> {
    prop::collection::vec(word(), TURN_TAPS)
        .prop_map(|words| words.try_into().expect("as many as a turn"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1024))]

    #[test]
    fn the_portable_sums_of_products_are_exact_but_for_whole_turns_of_64_bits(
        turns in prop::collection::vec(turn(), 0..4),
        samples in prop::collection::vec(word(), 4 * TURN_TAPS),
    ) {
        let coefficients = turns.as_flattened();
        let sums = Portable::sums_of_products(&turns, &samples);
        for (sum, place) in sums.into_iter().zip((0..SUMS).rev()) {
            let pairs = coefficients.iter().zip(&samples[place..]);
            let exact: i128 = pairs.map(|(&a, &b)| i128::from(a) * i128::from(b)).sum();
            prop_assert_eq!(sum, exact as i64);
        }
    }
}
