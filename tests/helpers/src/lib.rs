//! Signals, a library and assertions that tests of several crates share.

use std::path::PathBuf;

use model_format::{CodeSpec, Library, NodeFlags, NodeSpec, Texture, TextureSpec, encode};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use tempfile::TempDir;

/// Gaussian noise of unit variance.
pub fn noise(seed: u64, samples: usize) -> Vec<f64> {
    let generator = rand_pcg::Pcg64::seed_from_u64(seed);
    StandardNormal.sample_iter(generator).take(samples).collect()
}

/// A path in a new folder, which is removed with the value beside it.
pub fn new_file(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("there is room for a folder");
    let path = folder.path().join(name);
    (folder, path)
}

/// Passes `excitation` through a pair of poles at this angle, rad per sample, and radius:
/// y(n) = x(n) + 2 r cos(angle) y(n-1) - r² y(n-2).
pub fn resonant(excitation: impl IntoIterator<Item = f64>, angle: f64, radius: f64) -> Vec<f64> {
    let mut past = (0.0, 0.0);
    let step = |x: f64| {
        let y = x + 2.0 * radius * angle.cos() * past.0 - radius * radius * past.1;
        past = (y, past.0);
        y
    };
    excitation.into_iter().map(step).collect()
}

/// Largest prime factor of a number above 1.
pub fn largest_factor(number: usize) -> usize {
    let least = (2..=number.isqrt()).find(|&factor| number.is_multiple_of(factor));
    least.map_or(number, |factor| factor.max(largest_factor(number / factor)))
}

/// Asserts that `found` is within `tolerance` of `expected`.
#[track_caller]
pub fn near(found: f64, expected: f64, tolerance: f64) {
    let is_near = (found - expected).abs() <= tolerance;
    assert!(is_near, "{found} is not {expected} to within {tolerance}");
}

/// Asserts that a text, such as an error message, contains all these words, even if a line break separates them.
#[track_caller]
pub fn holds(text: &(impl std::fmt::Display + ?Sized), words: &[&str]) {
    let text = text.to_string();
    let in_one_line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    for word in words {
        let is_there = text.contains(word) || in_one_line.contains(word);
        assert!(is_there, "no '{word}' in: {text}");
    }
}

/// Returns a library of one texture: a grid of two speeds by two forces whose nodes differ in level and in spectral
/// shape.
pub fn library(sample_rate_hz: u32) -> Vec<u8> {
    let node = |output_power: f32, codes: &[i16]| NodeSpec {
        output_power,
        prediction_error_power: output_power / 2.0,
        flags: NodeFlags::NONE,
        codes: CodeSpec::lattice(codes.to_vec()),
    };
    let texture = TextureSpec {
        sample_rate_hz,
        ..TextureSpec::new(
            "test",
            &[50.0, 100.0],
            &[0.5, 1.0],
            vec![
                node(1.0, &[9000, -20_000]),
                node(4.0, &[3000]),
                node(9.0, &[]),
                node(16.0, &[-9000, 500, 20_000]),
            ],
        )
    };
    encode(&[texture]).unwrap()
}

/// The texture of [`library`].
pub fn texture(library: &[u8]) -> Texture<'_> {
    Library::decode(library).unwrap().texture("test").unwrap()
}
