//! Sums over samples in eight partial sums, which the compiler keeps in vector registers.
//!
//! A sum in the order of the samples waits for each addition before the next one. Eight partial sums do not, and their
//! round-off is the smaller one. Their order is fixed, so that every run of one build has the same digits.

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

/// Returns the mean of the squares of `values`, summed in their order; 0 of none.
pub fn mean_square(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64
}

/// Returns the root of [`mean_square`].
pub fn rms(values: &[f64]) -> f64 {
    mean_square(values).sqrt()
}

/// Returns the value in the middle of `values`, the upper one of an even number; `None` of none.
///
/// Thresholds take it: in place of the mean of both middle values, which is
/// [`liveliness::median`](crate::liveliness::median)'s, it is one of the values, and found without a sort.
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

/// As [`energy`], inlined.
#[inline(always)]
pub(crate) fn energy_inlined(values: &[f64]) -> f64 {
    sum_of(values, |x| x * x)
}

/// Returns the sum of the products of `a` and `b`, as far as both go.
pub fn dot<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> f64 {
    wide(
        #[inline(always)]
        || dot_inlined(a, b),
    )
}

/// As [`dot`], inlined.
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
    let rest = a_rest.iter().zip(b_rest);
    let rest: f64 = rest.map(|(&a, &b)| a.into() * b.into()).sum();
    sums.iter().sum::<f64>() + rest
}

/// Returns the sum of the products of `weights` with as many `values`, at each place where they all are.
///
/// Each sum is in the order of the weights. Many places have theirs made at once, so that none waits for another.
pub fn sliding(values: &[f64], weights: &[f64]) -> Vec<f64> {
    // As many as vector registers hold.
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
                // Fewer values than weights have no sums, and so none to start from.
                let values = values.get(place..).unwrap_or_default();
                for (sum, value) in rest.iter_mut().zip(values) {
                    *sum += value * weight;
                }
            }
        },
    );
    sums
}

/// Returns the mean of `values`, computed about the first one, so that a large offset costs no digits; 0 of none.
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

/// Returns the mean of the squares about the mean, computed about the first value; 0 of none.
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

/// Returns both [`mean`] and [`variance`].
pub fn moments(values: &[f64]) -> Moments {
    wide(
        #[inline(always)]
        || moments_inlined(values),
    )
}

/// As [`moments`], inlined.
#[inline(always)]
pub fn moments_inlined(values: &[f64]) -> Moments {
    let mean = mean_inlined(values);
    let squares = sum_of(values, |x| (x - mean) * (x - mean));
    Moments {
        mean,
        variance: squares / values.len().max(1) as f64,
    }
}

/// Returns the lowest and the highest of `values`, none of which is NaN; the largest and the smallest number of none.
pub fn extremes(values: &[f64]) -> (f64, f64) {
    wide(
        #[inline(always)]
        || extremes_inlined(values),
    )
}

/// As [`extremes`], inlined.
#[inline(always)]
pub(crate) fn extremes_inlined(values: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = ([f64::MAX; LANES], [f64::MIN; LANES]);
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for ((low, high), &x) in low.iter_mut().zip(&mut high).zip(chunk) {
            *low = if x < *low { x } else { *low };
            *high = if x > *high { x } else { *high };
        }
    }
    let least = low.iter().chain(rest).fold(f64::MAX, |a, &b| a.min(b));
    let most = high.iter().chain(rest).fold(f64::MIN, |a, &b| a.max(b));
    (least, most)
}

/// Returns the least step between neighbours that is not zero, and the largest; infinity and 0 of no step.
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
    let rest = before_rest.iter().zip(after_rest);
    let rest = rest.map(|(&before, &after)| step(before, after));
    let lanes = least
        .into_iter()
        .chain(rest.clone().filter(|&step| step > 0.0));
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
        /// The oracle is the sum in the order of the values; round-off is at most that of as many additions.
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
