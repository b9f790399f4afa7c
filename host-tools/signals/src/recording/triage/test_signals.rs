//! Signals that several tests of this folder use.

use rand::{RngExt, SeedableRng};

use model_format::SAMPLE_RATE_HZ;

pub const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// White noise of 2 s within ±2 m/s², of which no sample stands out as those of Gaussian noise do: not clipped, and
/// without bursts.
pub fn bounded_noise(seed: u64) -> Vec<f64> {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    (0..10_000)
        .map(|_| rng.random_range(-1.0..1.0) + rng.random_range(-1.0..1.0))
        .collect()
}

pub fn tone(frequency_hz: f64, amplitude: f64) -> impl Iterator<Item = f64> {
    let step = core::f64::consts::TAU * frequency_hz / RATE_HZ;
    (0..10_000).map(move |n| amplitude * (step * f64::from(n)).sin())
}

pub fn plus(signal: &[f64], other: impl Iterator<Item = f64>) -> Vec<f64> {
    signal.iter().zip(other).map(|(a, b)| a + b).collect()
}
