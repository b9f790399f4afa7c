//! Narrow peaks of one recording's spectrum, and how unlikely each is in noise.
//!
//! The periodogram with a Hann window of Gaussian noise has independent, exponentially distributed values at distances
//! of about 1/T, whose mean follows the spectral density. A line stands in one such cell. Its power is compared with
//! the medians of the cells to the left and to the right, the larger of which counts, so that the flank of a resonance
//! or of a band of noise is no line; a median is not raised by another line among the cells.

use std::cell::RefCell;
use std::f64::consts::{LN_2, TAU};
use std::rc::Rc;

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::fourier::{self, Complex};
use crate::dsp::sums::upper_median;

/// Cells left out on each side of a peak: the main lobe of the window, and its skirt.
const GUARD_CELLS: f64 = 3.0;

/// Cells on each side of a peak that tell its background.
const BACKGROUND_CELLS: f64 = 24.0;

/// Cells on each side that tell the background close by, of which a band of noise has its own share.
const CLOSE_CELLS: f64 = 5.0;

/// Independent exponential values whose mean is known as well as the background: 48 cells, of which a Hann window
/// leaves about half independent, by their median, which is half as exact as their mean.
const BACKGROUND_DEGREES: f64 = 12.0;

/// Least background as a share of the strongest line's power: 70 dB below it.
const FLOOR_SHARE: f64 = 1e-7;

/// Least ratio of a peak to its background that is kept.
const LEAST_RATIO: f64 = 6.0;

/// Least number of samples that is looked at: four backgrounds between 0 Hz and half the sample rate.
const LEAST_SAMPLES: usize = 1000;

/// A peak of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Peak {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Natural logarithm of the probability that a cell of noise is at least as far above its background.
    pub ln_chance: f64,
}

/// Returns whether lines can be sought in `signal`: it is neither too short nor silent.
pub(super) fn tells_lines(signal: &[f64]) -> bool {
    signal.len() >= LEAST_SAMPLES && signal.iter().any(|x| *x != 0.0)
}

/// Spectrum of a recording on a grid of frequencies finer than its resolution.
pub(super) struct LineSpectrum {
    power: Vec<f64>,
    step_hz: f64,
    /// Width of a cell, 1/T, Hz.
    pub cell_hz: f64,
    /// Sum of the window's squares.
    window_energy: f64,
    /// Least background, below which the skirts of the strongest line would be lines.
    pub floor: f64,
}

impl LineSpectrum {
    /// Spectrum of `signal`; `None` if it is too short, or silent.
    pub(super) fn of(signal: &[f64]) -> Option<Self> {
        if !tells_lines(signal) {
            return None;
        }
        // Steps of half a cell at most: between bins a cell apart, a Hann window loses up to 1.4 dB of a peak (Harris,
        // Proc. IEEE 66, 1978, 51, table 1).
        let length = (2 * signal.len()).next_power_of_two();
        let mut padded = vec![0.0; length];
        let mut window_energy = 0.0;
        let window = hann_window(signal.len());
        for ((out, x), weight) in padded.iter_mut().zip(signal).zip(&*window) {
            window_energy += weight * weight;
            *out = weight * x;
        }
        let bins = fourier::forward(&mut padded);
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let power: Vec<f64> = bins.iter().map(Complex::norm_sqr).collect();
        let strongest = power.iter().copied().fold(0.0, f64::max);
        Some(Self {
            floor: FLOOR_SHARE * strongest,
            power,
            step_hz: rate_hz / length as f64,
            cell_hz: rate_hz / signal.len() as f64,
            window_energy,
        })
    }

    /// Peaks from `lowest_hz` to `highest_hz` that stand out.
    pub(super) fn peaks(&self, lowest_hz: f64, highest_hz: f64) -> Vec<Peak> {
        let first = ((lowest_hz / self.step_hz).ceil() as usize).max(1);
        let last = ((highest_hz / self.step_hz) as usize).min(self.power.len() - 2);
        (first..=last)
            .filter(|&bin| {
                self.power[bin] > self.power[bin - 1] && self.power[bin] >= self.power[bin + 1]
            })
            .filter(|&bin| self.may_stand_out(bin))
            .filter_map(|bin| {
                let ratio = self.power[bin] / self.background(bin);
                (ratio > LEAST_RATIO).then(|| Peak {
                    frequency_hz: (bin as f64 + self.vertex(bin)) * self.step_hz,
                    // An exponential value over the mean of n others has an F distribution with 2 and 2n degrees of
                    // freedom: it exceeds r with a chance of (1 + r/n)^-n.
                    ln_chance: -BACKGROUND_DEGREES * (ratio / BACKGROUND_DEGREES).ln_1p(),
                })
            })
            .collect()
    }

    /// Mean square amplitude, (m/s²)², that noise alone gives a line measured at `frequency_hz` in `samples` samples.
    pub(super) fn noise_amplitude_squared(&self, frequency_hz: f64, samples: usize) -> f64 {
        let bin = ((frequency_hz / self.step_hz).round() as usize).clamp(1, self.power.len() - 2);
        // White noise of this density has a variance of background / window energy per sample, and least squares over N
        // samples give cosine and sine of a line in it a variance of 2/N of that each.
        4.0 * self.background(bin) / (self.window_energy * samples as f64)
    }

    /// Returns false for most bins that [`LEAST_RATIO`] leaves out: by counting, which is quicker than a median.
    fn may_stand_out(&self, bin: usize) -> bool {
        let least = self.power[bin] * LN_2 / LEAST_RATIO * (1.0 + 1e-9);
        let is_above = |powers: &[f64]| {
            let below = powers.iter().filter(|&&power| power < least).count();
            powers.is_empty() || below > powers.len() / 2
        };
        self.beside(bin, BACKGROUND_CELLS).into_iter().all(is_above)
    }

    /// Cells to the left and to the right of a bin, so many on each side.
    fn beside(&self, bin: usize, cells: f64) -> [&[f64]; 2] {
        let per_cell = self.cell_hz / self.step_hz;
        let bins = |cells: f64| (cells * per_cell).round() as usize;
        let (near, far) = (bins(GUARD_CELLS), bins(GUARD_CELLS + cells));
        let end = self.power.len();
        let left = bin.saturating_sub(far).max(1).min(bin)..bin.saturating_sub(near).max(1);
        let right = (bin + near + 1).min(end)..(bin + far + 1).min(end);
        [&self.power[left], &self.power[right]]
    }

    /// Mean power of noise around a bin: the largest of the cells to the left, to the right and close by.
    fn background(&self, bin: usize) -> f64 {
        let [left, right] = self.beside(bin, BACKGROUND_CELLS);
        let close = self.beside(bin, CLOSE_CELLS).concat();
        // The median of an exponential distribution is ln 2 of its mean.
        let mean = |powers: &[f64]| upper_median(powers).map_or(0.0, |median| median / LN_2);
        let background = mean(left).max(mean(right)).max(mean(&close));
        background.max(self.floor).max(f64::MIN_POSITIVE)
    }

    /// Place of the maximum of a parabola through three levels, in steps from `bin`.
    fn vertex(&self, bin: usize) -> f64 {
        // In logarithms, in which a window's main lobe is nearly a parabola.
        let level = |bin: usize| self.power[bin].max(f64::MIN_POSITIVE).ln();
        let (before, here, after) = (level(bin - 1), level(bin), level(bin + 1));
        let curvature = before - 2.0 * here + after;
        if curvature < 0.0 {
            (0.5 * (before - after) / curvature).clamp(-0.5, 0.5)
        } else {
            0.0
        }
    }
}

/// Weight of sample `n` of a Hann window of `length` samples.
pub(super) fn hann(n: usize, length: usize) -> f64 {
    0.5 - 0.5 * (TAU * (n as f64 + 0.5) / length as f64).cos()
}

thread_local! {
    /// The last window, because the recordings of a set are mostly of one length.
    static WINDOW: RefCell<Rc<[f64]>> = RefCell::new(Rc::new([]));
}

/// Weights of a Hann window of `length` samples.
pub(super) fn hann_window(length: usize) -> Rc<[f64]> {
    WINDOW.with_borrow_mut(|last| {
        if last.len() != length {
            *last = (0..length).map(|n| hann(n, length)).collect();
        }
        Rc::clone(last)
    })
}
