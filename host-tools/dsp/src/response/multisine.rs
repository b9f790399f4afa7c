//! The excitation: a multisine with a low crest factor.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::{PERIOD, STEP_HZ};
use crate::fourier::{self, Complex};
use crate::sums::rms;

/// Range of the lines, in bins: 10 Hz to 1 kHz. Its end is even, so the last line is below it.
const BINS: [usize; 2] = [4, 400];

/// Even bins that are lines too, because the third octaves around 10 and 20 Hz contain no odd bin.
const EVEN: [usize; 2] = [4, 8];

/// First bin from which on some odd lines are left out. Below it, third octaves have too few lines.
const FIRST_LEFT_OUT: usize = 21;

/// Number of neighbouring odd lines of which one, chosen at random, is left out.
const GROUP: usize = 4;

/// Rounds of clipping that lower the crest factor.
const ROUNDS: usize = 80;

/// A sum of sines with random phases, of peak 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Multisine {
    /// One period.
    pub samples: Vec<f64>,
    /// Bins of the lines that the waveform contains, ascending: odd bins, and a few even ones where bands are narrow.
    pub lines: Vec<usize>,
    /// Odd bins in between that the waveform leaves out.
    pub left_out: Vec<usize>,
}

impl Multisine {
    /// Creates the waveform whose lines have the relative amplitudes `amplitude`, a function of the frequency in Hz.
    ///
    /// Phases start at random. Then the samples are clipped and the amplitudes are restored in turn, which lowers the
    /// crest factor (Van der Ouderaa, Schoukens and Renneboog, IEEE Trans. Instrum. Meas. 37, 1988, 145).
    pub fn new(seed: u64, amplitude: impl Fn(f64) -> f64) -> Self {
        let mut random = Pcg32::seed_from_u64(seed);
        let (mut lines, mut left_out) = (EVEN.to_vec(), Vec::new());
        let odd: Vec<usize> = (BINS[0] + 1..=BINS[1]).step_by(2).collect();
        let (whole, thinned) = odd.split_at(odd.partition_point(|&bin| bin < FIRST_LEFT_OUT));
        lines.extend(whole);
        for group in thinned.chunks(GROUP) {
            let out = random.random_range(0..GROUP);
            for (place, &bin) in group.iter().enumerate() {
                let lines = if place == out { &mut left_out } else { &mut lines };
                lines.push(bin);
            }
        }
        lines.sort_unstable();
        let amplitudes: Vec<f64> = lines.iter().map(|&bin| amplitude(bin as f64 * STEP_HZ)).collect();
        let mut phases: Vec<f64> = lines
            .iter()
            .map(|_| random.random_range(0.0..std::f64::consts::TAU))
            .collect();
        let mut samples = period(&lines, &amplitudes, &phases);
        let mut best = (f64::INFINITY, samples.clone());
        for _ in 0..ROUNDS {
            let peak = peak(&samples);
            let crest = peak / rms(&samples);
            // Restoring the amplitudes can raise the crest factor again.
            if crest < best.0 {
                best = (crest, samples.clone());
            }
            let limit = 0.85 * peak;
            for sample in &mut samples {
                *sample = sample.clamp(-limit, limit);
            }
            let spectrum = spectrum(&samples);
            phases = lines.iter().map(|&bin| spectrum[bin].arg()).collect();
            samples = period(&lines, &amplitudes, &phases);
        }
        let (_, mut samples) = best;
        let peak = peak(&samples);
        samples.iter_mut().for_each(|sample| *sample /= peak);
        Self {
            samples,
            lines,
            left_out,
        }
    }

    /// Returns the waveform in units of 1/32767.
    pub fn codes(&self) -> Vec<i16> {
        let code = |sample: &f64| (sample * f64::from(i16::MAX)).round() as i16;
        self.samples.iter().map(code).collect()
    }

    /// Returns the root mean square of the waveform, whose peak is 1.
    pub fn rms(&self) -> f64 {
        rms(&self.samples)
    }
}

fn peak(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |peak: f64, sample| peak.max(sample.abs()))
}

fn period(lines: &[usize], amplitudes: &[f64], phases: &[f64]) -> Vec<f64> {
    let mut spectrum = vec![Complex::default(); PERIOD / 2 + 1];
    for ((&bin, &amplitude), &phase) in lines.iter().zip(amplitudes).zip(phases) {
        // The bin of the negative frequency carries the other half.
        spectrum[bin] = Complex::from_polar(0.5 * amplitude, phase);
    }
    fourier::inverse(&mut spectrum, PERIOD)
}

/// Returns the spectrum of one period: the complex amplitude of each bin.
pub(super) fn spectrum(samples: &[f64]) -> Vec<Complex<f64>> {
    fourier::forward(&mut samples.to_vec())
        .into_iter()
        .map(|bin| bin * (2.0 / PERIOD as f64))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    #[test]
    fn a_waveform_has_its_lines_at_their_amplitudes_no_other_and_a_low_crest() {
        for seed in 0..4 {
            let wave = Multisine::new(seed, |hz| (hz / 100.0).sqrt());
            near(peak(&wave.samples), 1.0, 1e-12);
            assert!(1.0 / wave.rms() < 2.2, "{}", 1.0 / wave.rms());
            let bins = spectrum(&wave.samples);
            let unit = bins[40 + 1].norm().max(bins[40 + 3].norm()) / 1.02;
            for (bin, value) in bins.iter().enumerate() {
                let expected = (bin as f64 * STEP_HZ / 100.0).sqrt();
                if wave.lines.contains(&bin) {
                    assert!((value.norm() / expected / unit - 1.0).abs() < 0.06, "{bin}");
                } else {
                    assert!(value.norm() < 1e-12);
                }
            }
            assert!(wave.left_out.len() > 40 && wave.left_out.iter().all(|bin| bin % 2 == 1));
        }
    }
}
