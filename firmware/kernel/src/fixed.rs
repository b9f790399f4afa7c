//! Fixed-point steps. Those of signals round toward zero, so that no rounding adds energy or a bias; the others say how
//! they round.

/// The upper half of `sum`, truncated toward zero. A negative sum whose lower half is zero comes out one step nearer to
/// zero, never farther.
///
/// On ARM this takes one instruction after the product: `add hi, hi, hi, lsr #31`.
#[inline(always)]
pub fn high_word_toward_zero(sum: i64) -> i32 {
    let high = (sum >> 32) as i32;
    high - (high >> 31)
}

/// The upper half of `product`. On ARM this takes one instruction together with the product.
#[inline(always)]
pub fn high_word(product: i64) -> i32 {
    (product >> 32) as i32
}

/// `word` · `half` / 2¹⁶, rounded down: one instruction on ARM.
#[inline(always)]
pub fn high_product(word: i32, half: i16) -> i32 {
    ((i64::from(word) * i64::from(half)) >> 16) as i32
}

/// The upper half of `product`, rounded to nearest. On ARM this takes one instruction together with the product.
#[inline(always)]
pub fn high_word_rounded(product: i64) -> i32 {
    ((product + (1 << 31)) >> 32) as i32
}

/// `word` plus the upper half of `product`, rounded to nearest once. The sum must fit in a word. On ARM this takes one
/// instruction together with the product.
#[inline(always)]
pub fn plus_high_word(word: i32, product: i64) -> i32 {
    (((i64::from(word) << 32) + product + (1 << 31)) >> 32) as i32
}

/// `value` / 2^`bits`, truncated toward zero, for `bits` below 63.
///
/// Computed as a sum and a shift, because the time of a division depends on the data, even by a power of two unless it
/// is a constant.
#[inline(always)]
pub fn shift_toward_zero(value: i64, bits: u32) -> i64 {
    let below_one = (1i64 << bits) - 1;
    (value + ((value >> 63) & below_one)) >> bits
}

/// `value` saturated to 32 bits; the flag is true if saturation changed it.
#[inline(always)]
pub fn saturate(value: i64) -> (i32, bool) {
    let (word, sign) = (value as i32, (value >> 63) as i32);
    let saturated = (value >> 32) as i32 != word >> 31;
    let kept = if saturated { i32::MAX ^ sign } else { word };
    (kept, saturated)
}

/// Returns whether `signal` is at either end of its range.
#[inline(always)]
#[expect(
    clippy::needless_bitwise_bool,
    reason = "a lazy operator may become a branch, whose path would depend on the data"
)]
pub fn is_full_scale(signal: i32) -> bool {
    (signal == i32::MAX) | (signal == i32::MIN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_high_word_is_never_larger_in_magnitude_than_the_exact_quotient(sum: i64) {
            let (high, exact) = (i128::from(high_word_toward_zero(sum)), i128::from(sum));
            prop_assert!((high << 32).abs() <= exact.abs());
            prop_assert!(((high << 32) - exact).abs() <= 1 << 32);
        }

        #[test]
        fn shifting_is_division_that_truncates(value in i64::MIN / 2..i64::MAX / 2, bits in 0u32..62) {
            prop_assert_eq!(shift_toward_zero(value, bits), value / (1 << bits));
        }

        #[test]
        fn saturation_is_told_exactly_when_it_happens(value: i64) {
            let (kept, saturated) = saturate(value);
            prop_assert_eq!(saturated, i64::from(kept) != value);
        }
    }
}
