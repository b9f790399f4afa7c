//! The dual multiplication against plain 64-bit arithmetic.

use proptest::prelude::*;
use stylus_kernel::arithmetic::{Arithmetic, Portable, pack};

fn exact(sum: i64, a: [i16; 2], b: [i16; 2]) -> i64 {
    let product = |lane: usize| i64::from(a[lane]) * i64::from(b[lane]);
    sum.wrapping_add(product(0)).wrapping_add(product(1))
}

fn sample() -> impl Strategy<Value = i16> {
    prop_oneof![3 => any::<i16>(), 1 => Just(i16::MIN), 1 => Just(i16::MAX), 1 => -1i16..=1]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn the_portable_dual_multiplication_is_exact(
        sum: i64, a in [sample(), sample()], b in [sample(), sample()],
    ) {
        prop_assert_eq!(Portable::multiply_accumulate(sum, pack(a), pack(b)), exact(sum, a, b));
    }
}
