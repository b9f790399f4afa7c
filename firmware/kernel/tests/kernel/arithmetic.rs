//! The sum of products against integers that cannot overflow.

use proptest::prelude::*;
use stylus_kernel::arithmetic::{Arithmetic, Portable, TURN_TAPS, Turn};

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
    fn the_portable_sum_of_products_is_exact_but_for_whole_turns_of_64_bits(
        turns in prop::collection::vec((turn(), turn()), 0..4),
    ) {
        let (a, b): (Vec<Turn>, Vec<Turn>) = turns.into_iter().unzip();
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        let exact: i128 = pairs.map(|(&a, &b)| i128::from(a) * i128::from(b)).sum();
        prop_assert_eq!(Portable::sum_of_products(&a, &b), exact as i64);
    }
}
