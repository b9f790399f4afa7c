//! Points of a cell, one by one, by the step-down recursion.

use super::finding::Point;
use crate::dsp::linear_prediction::step_down;

/// Steps along each side of a cell between sampled points.
pub const SAMPLES_PER_SIDE: u32 = 8;

/// Tolerance of a pole radius.
const RADIUS_TOLERANCE: f64 = 1e-7;

/// Largest pole radius that is looked for; nodes with Σ|h| of 1024 cannot have a larger one than 1024.
const LARGEST_RADIUS: f64 = 1024.0;

/// The point of the largest pole radius among those sampled. `corners` are the nodes' polynomials, a(0) first, in the order
/// (low speed, low force), (low, high), (high, low), (high, high), those of an axis of one value left out.
pub(super) fn worst(corners: &[&[f64]], speeds_mm_s: [f32; 2], forces_n: [f32; 2]) -> Point {
    let between = |[low, high]: [f32; 2], share: f64| {
        f64::from(low) + (f64::from(high) - f64::from(low)) * share
    };
    let along = |[low, high]: [f32; 2]| if low < high { SAMPLES_PER_SIDE } else { 0 };
    let mut worst = Point {
        speed_mm_s: f64::from(speeds_mm_s[0]),
        force_n: f64::from(forces_n[0]),
        pole_radius: 0.0,
    };
    for speed in 0..=along(speeds_mm_s) {
        for force in 0..=along(forces_n) {
            let share = |step: u32| f64::from(step) / f64::from(SAMPLES_PER_SIDE);
            let (s, f) = (share(speed), share(force));
            let of_speeds = if along(speeds_mm_s) > 0 {
                vec![1.0 - s, s]
            } else {
                vec![1.0]
            };
            let of_forces = if along(forces_n) > 0 {
                vec![1.0 - f, f]
            } else {
                vec![1.0]
            };
            let weights = of_speeds
                .iter()
                .flat_map(|s| of_forces.iter().map(move |f| s * f));
            let mean = weighted_mean(corners, weights);
            if let Some(pole_radius) = radius_above(&mean, worst.pole_radius) {
                worst = Point {
                    speed_mm_s: between(speeds_mm_s, s),
                    force_n: between(forces_n, f),
                    pole_radius,
                };
            }
        }
    }
    worst
}

fn weighted_mean(corners: &[&[f64]], weights: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut mean = vec![0.0; corners[0].len()];
    for (corner, weight) in corners.iter().zip(weights) {
        for (sum, a) in mean.iter_mut().zip(*corner) {
            *sum += weight * a;
        }
    }
    mean
}

/// The largest magnitude of a zero of Σ a(i) z⁻ⁱ, if it is above `bound`.
fn radius_above(a: &[f64], bound: f64) -> Option<f64> {
    if bound > 0.0 && all_within(a, bound) {
        return None;
    }
    // Most filters' poles are near the circle or within; the search goes out from there.
    let mut high = bound.max(1.0);
    let mut low = bound;
    while high < LARGEST_RADIUS && !all_within(a, high) {
        low = high;
        high = 1.0 + 2.0 * (high - 1.0).max(1e-3);
    }
    while high - low > RADIUS_TOLERANCE {
        let middle = f64::midpoint(low, high);
        if all_within(a, middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    (high > bound).then_some(high)
}

/// Returns whether all zeros are within `radius`, that is, whether A(z · radius) is stable.
fn all_within(a: &[f64], radius: f64) -> bool {
    let mut power = 1.0;
    let scaled: Vec<f64> = a[1..]
        .iter()
        .map(|a| {
            power /= radius;
            a * power
        })
        .collect();
    scaled.iter().all(|a| a.is_finite()) && step_down(&scaled).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Σ a(i) z⁻ⁱ with these pairs of zeros.
    fn polynomial(zeros: &[(f64, f64)]) -> Vec<f64> {
        let mut polynomial = vec![1.0];
        for (radius, angle) in zeros {
            let factor = [1.0, -2.0 * radius * angle.cos(), radius * radius];
            let mut product = vec![0.0; polynomial.len() + 2];
            for (i, a) in polynomial.iter().enumerate() {
                for (j, b) in factor.iter().enumerate() {
                    product[i + j] += a * b;
                }
            }
            polynomial = product;
        }
        polynomial
    }

    proptest! {
        #[test]
        fn the_radius_is_that_of_the_outermost_zero(
            zeros in prop::collection::vec((0.1f64..3.0, 0.1f64..3.0), 1..5),
        ) {
            let outermost = zeros.iter().fold(0.0, |most: f64, (radius, _)| most.max(*radius));
            let found = radius_above(&polynomial(&zeros), 0.0).unwrap();
            prop_assert!((found - outermost).abs() < 1e-4, "{} for {}", found, outermost);
            prop_assert_eq!(radius_above(&polynomial(&zeros), outermost + 1e-3), None);
        }
    }
}
