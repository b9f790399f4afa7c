//! Signals that the tests of this folder share.

use std::f64::consts::TAU;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

pub const RATE_HZ: f64 = 5000.0;

pub fn noise(len: usize, seed: u64) -> Vec<f64> {
    let generator = rand_pcg::Pcg64::seed_from_u64(seed);
    StandardNormal.sample_iter(generator).take(len).collect()
}

pub fn scaled(signal: &[f64], factor: f64) -> Vec<f64> {
    signal.iter().map(|value| factor * value).collect()
}

pub fn sine(len: usize, frequency_hz: f64, amplitude: f64) -> Vec<f64> {
    let sample = |n: usize| amplitude * (TAU * frequency_hz * n as f64 / RATE_HZ).sin();
    (0..len).map(sample).collect()
}

pub fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs())
}
