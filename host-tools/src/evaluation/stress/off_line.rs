//! Noise of a filter's arithmetic beside its lines.
//!
//! Truncation damps: a line that rings for long comes out a little weaker and broader, in phase with what it should be.
//! A waveform's SNR counts that as noise. What is felt as noise is the error where the signal itself is weak.

use std::f64::consts::TAU;

use realfft::num_complex::Complex;

use crate::dsp::with_planner;

/// Samples per segment of the spectra: 0.6 Hz per bin at the models' rate.
const SEGMENT: usize = 8192;

/// A frequency is off the lines where the reference is at least so far below its strongest frequency: 60 dB.
const OFF_THE_LINE: f64 = 1e-6;

/// Cosine terms of the window, whose side lobes are 92 dB down, so that the error in a line does not leak off it
/// (Blackman-Harris; Harris, Proc. IEEE 66, 1978, 51).
const WINDOW: [f64; 4] = [0.35875, -0.48829, 0.14128, -0.01168];

/// Spectra of a signal's reference and of its error, over windowed segments.
#[derive(Default)]
pub struct OffLine {
    segment: Vec<(f64, f64)>,
    reference: Vec<f64>,
    error: Vec<f64>,
}

impl OffLine {
    /// One sample of both.
    pub fn add(&mut self, reference: f64, actual: f64) {
        self.segment.push((reference, actual - reference));
        if self.segment.len() == SEGMENT {
            let of = |part: fn(&(f64, f64)) -> f64| {
                let samples = self.segment.iter().map(part);
                periodogram(samples)
            };
            let (reference, error) = (of(|pair| pair.0), of(|pair| pair.1));
            for (sums, powers) in [(&mut self.reference, reference), (&mut self.error, error)] {
                sums.resize(powers.len(), 0.0);
                sums.iter_mut()
                    .zip(powers)
                    .for_each(|(sum, power)| *sum += power);
            }
            self.segment.clear();
        }
    }

    /// Returns the power of the error at frequencies off the lines over the reference's whole power, dB; `None` if no
    /// frequency is off a line, or if there were too few samples.
    pub fn noise_dbc(&self) -> Option<f64> {
        let strongest = self.reference.iter().copied().fold(0.0, f64::max);
        let pairs = self.reference.iter().zip(&self.error);
        let off = pairs.filter(|(reference, _)| **reference < OFF_THE_LINE * strongest);
        let noise: f64 = off.map(|(_, error)| error).sum();
        let level = 10.0 * (noise / self.reference.iter().sum::<f64>()).log10();
        Some(level).filter(|level| level.is_finite())
    }
}

fn periodogram(samples: impl Iterator<Item = f64>) -> Vec<f64> {
    let forward = with_planner(|planner| planner.plan_fft_forward(SEGMENT));
    let window = |n: usize| {
        let terms = WINDOW.iter().enumerate();
        let angle = TAU * n as f64 / SEGMENT as f64;
        terms
            .map(|(k, a)| a * (k as f64 * angle).cos())
            .sum::<f64>()
    };
    let mut windowed: Vec<f64> = samples.enumerate().map(|(n, x)| window(n) * x).collect();
    let mut spectrum = forward.make_output_vec();
    forward
        .process(&mut windowed, &mut spectrum)
        .expect("lengths come from the plan");
    spectrum.iter().map(Complex::norm_sqr).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn damping_of_a_line_is_no_noise_and_noise_beside_it_is_all_of_it() {
        let line = |n: usize| (TAU * 100.3 * n as f64 / 5000.0).sin();
        let noise: Vec<f64> = StandardNormal
            .sample_iter(rand_pcg::Pcg64::seed_from_u64(1))
            .take(8 * SEGMENT)
            .collect();
        let measured = |gain: f64, deviation: f64| {
            let mut off_line = OffLine::default();
            for (n, noise) in noise.iter().enumerate() {
                off_line.add(line(n), gain * line(n) + deviation * noise);
            }
            off_line.noise_dbc().unwrap()
        };
        // 100 dB below a power of a half, with and without an error of 60 dB below it in the line.
        let deviation = 1e-5 * 0.5f64.sqrt();
        assert!((measured(1.0, deviation) + 100.0).abs() < 0.3);
        assert!((measured(0.999, deviation) + 100.0).abs() < 0.3);
        assert!(measured(0.999, 0.0) < -115.0);
    }

    #[test]
    fn a_broad_signal_has_nothing_off_the_line() {
        let mut off_line = OffLine::default();
        let noise = StandardNormal.sample_iter(rand_pcg::Pcg64::seed_from_u64(2));
        for x in noise.take(64 * SEGMENT) {
            let x: f64 = x;
            off_line.add(x, 1.001 * x);
        }
        assert_eq!(off_line.noise_dbc(), None);
    }
}
