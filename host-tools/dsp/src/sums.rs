//! Sums over samples in eight partial sums, which the compiler keeps in vector registers.
//!
//! If samples are summed in order, each addition waits for the one before it. Eight partial sums do not wait for each
//! other, and their round-off is smaller. Their order is fixed, so that every run of one build gives the same digits.

use super::wide;

/// Number of partial sums.
const LANES: usize = 8;

/// Returns the sum of `values`.
pub fn sum(values: &[f64]) -> f64 {
    wide(
        #[inline(always)]
        || sum_of(values, |x| x),
    )
}

/// Returns the mean of the squares of `values`, summed in order; 0 if there are no values.
pub fn mean_square(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64
}

/// Returns the root of [`mean_square`].
pub fn rms(values: &[f64]) -> f64 {
    mean_square(values).sqrt()
}

/// Returns the middle value of `values`, which is the upper middle value if their number is even; `None` if there are
/// none.
///
/// Thresholds use this median. Unlike [`liveliness::median`](crate::liveliness::median), which is the mean of the two
/// middle values if the number is even, it is always one of the values, and it is found without sorting.
pub fn upper_median(values: &[f64]) -> Option<f64> {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the sum of `term` over `values`, inlined.
#[inline(always)]
pub fn sum_of(values: &[f64], term: impl Fn(f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for (sum, &x) in sums.iter_mut().zip(chunk) {
            *sum += term(x);
        }
    }
    let rest: f64 = rest.iter().map(|&x| term(x)).sum();
    sums.iter().sum::<f64>() + rest
}

/// Returns the sum of the squares of `values`.
pub fn energy(values: &[f64]) -> f64 {
    wide(
        #[inline(always)]
        || energy_inlined(values),
    )
}

/// Like [`energy`], inlined.
#[inline(always)]
pub(crate) fn energy_inlined(values: &[f64]) -> f64 {
    sum_of(values, |x| x * x)
}

/// Returns the sum of the products of `a` and `b`, up to the end of the shorter slice.
pub fn dot<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> f64 {
    wide(
        #[inline(always)]
        || dot_inlined(a, b),
    )
}

/// Like [`dot`], inlined.
#[inline(always)]
pub(crate) fn dot_inlined<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> f64 {
    let common = a.len().min(b.len());
    let mut sums = [0.0; LANES];
    let (a_chunks, a_rest) = a[..common].as_chunks::<LANES>();
    let (b_chunks, b_rest) = b[..common].as_chunks::<LANES>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for ((sum, &a), &b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a.into() * b.into();
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(&a, &b)| a.into() * b.into()).sum();
    sums.iter().sum::<f64>() + rest
}

/// Returns, for each position at which all `weights` lie within `values`, the sum of the products of `weights` and the
/// values from there on.
///
/// Each sum is in the order of the weights. The sums of many positions are computed together, so that no addition waits
/// for another.
pub fn sliding(values: &[f64], weights: &[f64]) -> Vec<f64> {
    // As many sums as fit into the vector registers.
    const AT_ONCE: usize = 32;
    let mut sums = vec![0.0; (values.len() + 1).saturating_sub(weights.len())];
    wide(
        #[inline(always)]
        || {
            let (blocks, rest) = sums.as_chunks_mut::<AT_ONCE>();
            let rest_at = AT_ONCE * blocks.len();
            for (block, sums) in blocks.iter_mut().enumerate() {
                let mut own = [0.0; AT_ONCE];
                for (place, weight) in (AT_ONCE * block..).zip(weights) {
                    for (sum, value) in own.iter_mut().zip(&values[place..place + AT_ONCE]) {
                        *sum += value * weight;
                    }
                }
                *sums = own;
            }
            for (place, weight) in (rest_at..).zip(weights) {
                // If there are fewer values than weights, there are no sums, and `place` may lie beyond the values.
                let values = values.get(place..).unwrap_or_default();
                for (sum, value) in rest.iter_mut().zip(values) {
                    *sum += value * weight;
                }
            }
        },
    );
    sums
}

/// Returns the mean of `values`; 0 if there are none. The first value is subtracted before summing, so that a large
/// offset costs no digits.
pub fn mean(values: &[f64]) -> f64 {
    wide(
        #[inline(always)]
        || mean_inlined(values),
    )
}

#[inline(always)]
fn mean_inlined(values: &[f64]) -> f64 {
    let Some(&first) = values.first() else {
        return 0.0;
    };
    first + sum_of(values, |x| x - first) / values.len() as f64
}

/// Returns the mean square deviation from the mean; 0 if there are no values. The mean is computed like [`mean`].
pub fn variance(values: &[f64]) -> f64 {
    moments(values).variance
}

/// Mean and variance of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// See [`mean`].
    pub mean: f64,
    /// See [`variance`].
    pub variance: f64,
}

/// Returns [`mean`] and [`variance`] together.
pub fn moments(values: &[f64]) -> Moments {
    wide(
        #[inline(always)]
        || moments_inlined(values),
    )
}

/// Like [`moments`], inlined.
#[inline(always)]
pub fn moments_inlined(values: &[f64]) -> Moments {
    let mean = mean_inlined(values);
    let squares = sum_of(values, |x| (x - mean) * (x - mean));
    Moments {
        mean,
        variance: squares / values.len().max(1) as f64,
    }
}

/// Returns the lowest and the highest of `values`, none of which is negative; 0 if there are none.
pub fn range_of(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    (low.min(high), high)
}

/// Returns the lowest and the highest of `values`, none of which may be NaN. If there are no values, it returns
/// `f64::MAX` and `f64::MIN`.
pub fn extremes(values: &[f64]) -> (f64, f64) {
    wide(
        #[inline(always)]
        || extremes_inlined(values),
    )
}

/// Like [`extremes`], inlined.
#[inline(always)]
pub(crate) fn extremes_inlined(values: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = ([f64::MAX; LANES], [f64::MIN; LANES]);
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for ((low, high), &x) in low.iter_mut().zip(&mut high).zip(chunk) {
            // Unlike `min`, a comparison without regard to NaN is one vector instruction.
            *low = if x < *low { x } else { *low };
            *high = if x > *high { x } else { *high };
        }
    }
    let least = low.iter().chain(rest).fold(f64::MAX, |a, &b| a.min(b));
    let most = high.iter().chain(rest).fold(f64::MIN, |a, &b| a.max(b));
    (least, most)
}

/// Returns the smallest step between neighbours that is not zero, and the largest step. If there are no such steps, it
/// returns infinity and 0.
pub fn steps(values: &[f64]) -> (f64, f64) {
    wide(
        #[inline(always)]
        || steps_inlined(values),
    )
}

#[inline(always)]
fn steps_inlined(values: &[f64]) -> (f64, f64) {
    let step = |before: f64, after: f64| (after - before).abs();
    let (mut least, mut most) = ([f64::INFINITY; LANES], [0.0_f64; LANES]);
    let after = values.get(1..).unwrap_or_default();
    let (befores, before_rest) = values[..after.len()].as_chunks::<LANES>();
    let (afters, after_rest) = after.as_chunks::<LANES>();
    for (before, after) in befores.iter().zip(afters) {
        for lane in 0..LANES {
            let step = step(before[lane], after[lane]);
            let over_zero = if step > 0.0 { step } else { f64::INFINITY };
            least[lane] = if over_zero < least[lane] {
                over_zero
            } else {
                least[lane]
            };
            most[lane] = if step > most[lane] { step } else { most[lane] };
        }
    }
    let rest = before_rest
        .iter()
        .zip(after_rest)
        .map(|(&before, &after)| step(before, after));
    let lanes = least.into_iter().chain(rest.clone().filter(|&step| step > 0.0));
    (
        lanes.fold(f64::INFINITY, f64::min),
        most.into_iter().chain(rest).fold(0.0, f64::max),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The reference is the sum in the order of the values. The round-off is at most that of as many additions.
        #[test]
        fn partial_results_are_those_in_order_to_round_off(values in prop::collection::vec(-1e3f64..1e3, 0..100)) {
            let bound = 1e-13 * values.iter().map(|x| x * x).sum::<f64>().max(1e3);
            let ordered: f64 = values.iter().map(|x| x * x).sum();
            prop_assert!((energy(&values) - ordered).abs() <= bound);
            prop_assert!((dot(&values, &values) - ordered).abs() <= bound);
            prop_assert!((sum(&values) - values.iter().sum::<f64>()).abs() <= bound);
            let all = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            let least = all.clone().filter(|&step| step > 0.0).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(steps(&values), (least, all.fold(0.0, f64::max)));
            let (low, high) = extremes(&values);
            prop_assert!(values.iter().all(|&x| (low..=high).contains(&x)));
            if !values.is_empty() {
                prop_assert!(values.contains(&low) && values.contains(&high));
                let lifted: Vec<f64> = values.iter().map(|x| x + 1e6).collect();
                prop_assert!((variance(&lifted) - variance(&values)).abs() <= 1e-6 * variance(&values) + 1e-6);
                prop_assert!((mean(&lifted) - 1e6 - mean(&values)).abs() <= 1e-6);
            }
        }

        #[test]
        fn sums_at_many_places_are_those_of_each_by_itself(
            values in prop::collection::vec(-1e3f64..1e3, 0..150), weights in prop::collection::vec(-1f64..1.0, 1..100),
        ) {
            let one = |values: &[f64]| values.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>();
            prop_assert_eq!(sliding(&values, &weights), values.windows(weights.len()).map(one).collect::<Vec<_>>());
        }
    }
}
