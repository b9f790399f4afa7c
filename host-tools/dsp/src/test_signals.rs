//! Signals for tests.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Gaussian noise of unit variance.
pub fn noise(seed: u64, samples: usize) -> Vec<f64> {
    let generator = rand_pcg::Pcg64::seed_from_u64(seed);
    StandardNormal
        .sample_iter(generator)
        .take(samples)
        .collect()
}

/// Asserts that a value is within `tolerance` of another.
#[track_caller]
pub fn near(found: f64, expected: f64, tolerance: f64) {
    let is_near = (found - expected).abs() <= tolerance;
    assert!(is_near, "{found} is not {expected} to within {tolerance}");
}
