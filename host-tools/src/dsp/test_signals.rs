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
