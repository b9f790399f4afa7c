//! Exact values of a Fourier series at uniformly spaced points, by the chirp z-transform (Bluestein 1970; Rabiner,
//! Schafer and Rader 1969).
//!
//! A trial's samples are v/fs apart on a track of period L, and L is seldom a multiple of v/fs. The substitution ni =
//! (n² + i² - (i-n)²)/2 turns Σ cₙ W^{ni} into one convolution by FFT, so that no interpolation is needed.

use std::f64::consts::TAU;

use stylus_dsp::fourier::{self, Complex};

/// Evaluator of series of up to a given number of terms at the points `0, step, 2·step ...`.
pub(super) struct UniformSampler {
    terms: usize,
    samples: usize,
    /// W^{j²/2}.
    chirp: Vec<Complex<f64>>,
    /// Spectra of the real and imaginary part of W^{-j²/2}, with the inverse transform's factor.
    kernel: [Vec<Complex<f64>>; 2],
}

impl UniformSampler {
    /// Creates an evaluator of `terms` terms at `samples` points, which are `step_cycles` periods of the series apart.
    pub(super) fn new(terms: usize, samples: usize, step_cycles: f64) -> Self {
        let chirp: Vec<_> = (0..=terms.max(samples))
            .map(|j| {
                // Whole turns are removed before the factor of 2π rounds the angle.
                let square = (j as f64) * (j as f64);
                Complex::cis(TAU * (0.5 * step_cycles * square).fract())
            })
            .collect();
        let length = fast_length(terms + samples);
        let kernel = [|c: Complex<f64>| c.re, |c: Complex<f64>| -c.im].map(|part| {
            let mut circular = vec![0.0; length];
            for (j, value) in circular[..samples].iter_mut().enumerate() {
                *value = part(chirp[j]) / length as f64;
            }
            // The differences i - n reach down to -terms.
            for j in 1..=terms {
                circular[length - j] = part(chirp[j]) / length as f64;
            }
            fourier::forward(&mut circular)
        });
        Self {
            terms,
            samples,
            chirp,
            kernel,
        }
    }

    /// Returns Re Σ_{n≥1} cₙ e^{2πi n i·step} for i = 0, 1 ...; `coefficients[n]` is cₙ and `coefficients[0]` is not
    /// used.
    pub(super) fn real_part(&self, coefficients: &[Complex<f64>]) -> Vec<f64> {
        let length = fast_length(self.terms + self.samples);
        let mut parts = [vec![0.0; length], vec![0.0; length]];
        for (n, coefficient) in coefficients.iter().enumerate().take(self.terms + 1).skip(1) {
            let value = coefficient * self.chirp[n];
            parts[0][n] = value.re;
            parts[1][n] = value.im;
        }
        let [real, imaginary] = parts.map(|mut part| fourier::forward(&mut part));
        let mut product_real = vec![Complex::default(); real.len()];
        let mut product_imaginary = product_real.clone();
        for bin in 0..real.len() {
            let (kernel_real, kernel_imaginary) = (self.kernel[0][bin], self.kernel[1][bin]);
            product_real[bin] = real[bin] * kernel_real - imaginary[bin] * kernel_imaginary;
            product_imaginary[bin] = real[bin] * kernel_imaginary + imaginary[bin] * kernel_real;
        }
        let real = fourier::inverse(&mut product_real, length);
        let imaginary = fourier::inverse(&mut product_imaginary, length);
        self.chirp[..self.samples]
            .iter()
            .zip(real.iter().zip(&imaginary))
            .map(|(chirp, (real, imaginary))| chirp.re * real - chirp.im * imaginary)
            .collect()
    }
}

/// Returns the least even length of at least `least` that is a power of two, or three times a power of two.
fn fast_length(least: usize) -> usize {
    let least = least.max(4);
    let power = least.next_power_of_two();
    let three_quarters = power / 4 * 3;
    if three_quarters >= least { three_quarters } else { power }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    use super::*;

    proptest! {
        #[test]
        fn samples_are_those_of_the_sum(
            terms in 1_usize..60,
            given in 0_usize..80,
            samples in 1_usize..60,
            step_cycles in 1e-4..0.02_f64,
            seed: u64,
        ) {
            let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
            let coefficients: Vec<_> = (0..=given)
                .map(|_| Complex::new(random.random::<f64>() - 0.5, random.random::<f64>() - 0.5))
                .collect();
            let sampler = UniformSampler::new(terms, samples, step_cycles);
            let computed = sampler.real_part(&coefficients);
            prop_assert_eq!(computed.len(), samples);
            for (i, value) in computed.iter().enumerate() {
                let expected: f64 = (1..=terms.min(given))
                    .map(|n| (coefficients[n] * Complex::cis(TAU * step_cycles * (n * i) as f64)).re)
                    .sum();
                prop_assert!((value - expected).abs() < 1e-11, "{} against {}", value, expected);
            }
        }

        #[test]
        fn transforms_are_long_enough_and_at_most_half_too_long(
            least in prop_oneof![1_usize..16, 1_usize..100_000],
        ) {
            let length = fast_length(least);
            prop_assert!(length >= least && length.is_multiple_of(2) && length <= (least.max(4) * 3).div_ceil(2));
        }
    }
}
