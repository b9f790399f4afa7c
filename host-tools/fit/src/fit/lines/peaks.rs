//! Narrow peaks of one recording's spectrum, and how improbable each is in noise.
//!
//! The periodogram of Gaussian noise with a Hann window has independent, exponentially distributed values at distances
//! of about 1/T, called cells. Their mean follows the spectral density. A line stands in one such cell. Its power is
//! compared with the medians of the cells to its left and to its right, and the larger median counts, so that the flank
//! of a resonance or of a band of noise is not taken for a line. A median is not raised by another line among the
//! cells.

use std::cell::RefCell;
use std::f64::consts::{LN_2, TAU};
use std::rc::Rc;

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::sums::upper_median;

/// Range of lines' frequencies, Hz: from above the hand's motion to where the device fades lines out.
pub(super) const LOWEST_HZ: f64 = 12.0;
pub(super) const HIGHEST_HZ: f64 = 2200.0;

/// Cells left out on each side of a peak: the main lobe of the window, and its skirt.
const GUARD_CELLS: f64 = 3.0;

/// Cells on each side of a peak from which its background is estimated.
const BACKGROUND_CELLS: f64 = 24.0;

/// Cells on each side from which the background close by is estimated. A narrow band of noise raises only this
/// estimate.
const CLOSE_CELLS: f64 = 5.0;

/// Number of independent exponential values whose mean is known as exactly as the background. The background has 48
/// cells; a Hann window leaves about half of them independent, and a median is half as exact as a mean.
const BACKGROUND_DEGREES: f64 = 12.0;

/// Least background relative to the strongest line's power: 70 dB below it.
const FLOOR_SHARE: f64 = 1e-7;

/// Least ratio of a kept peak to its background.
const LEAST_RATIO: f64 = 6.0;

/// Least number of samples of a signal that is searched. It gives 500 cells between 0 Hz and half the sample rate,
/// which is about nine times the width of a background.
const LEAST_SAMPLES: usize = 1000;

/// A peak of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Peak {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Natural logarithm of the probability that a cell of noise exceeds its background at least as much.
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
    /// Least background. Without it, the skirts of the strongest line would count as lines.
    pub floor: f64,
}

impl LineSpectrum {
    /// Spectrum of `signal`; `None` if it is too short, or silent.
    pub(super) fn of(signal: &[f64]) -> Option<Self> {
        if !tells_lines(signal) {
            return None;
        }
        // Steps of at most half a cell: between bins a cell apart, a Hann window loses up to 1.4 dB of a peak (Harris,
        // Proc. IEEE 66, 1978, 51, table 1).
        let length = fourier::quick_length(2 * signal.len());
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

    /// Peaks that stand out, from [`LOWEST_HZ`] to [`HIGHEST_HZ`].
    pub(super) fn peaks(&self) -> Vec<Peak> {
        let first = ((LOWEST_HZ / self.step_hz).ceil() as usize).max(1);
        let last = ((HIGHEST_HZ / self.step_hz) as usize).min(self.power.len() - 2);
        (first..=last)
            .filter(|&bin| self.power[bin] > self.power[bin - 1] && self.power[bin] >= self.power[bin + 1])
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

    /// Mean squared amplitude that noise alone produces in a line fitted at `frequency_hz` to `samples` samples,
    /// (m/s²)².
    pub(super) fn noise_amplitude_squared(&self, frequency_hz: f64, samples: usize) -> f64 {
        let bin = ((frequency_hz / self.step_hz).round() as usize).clamp(1, self.power.len() - 2);
        // White noise of this density has a variance of background / window energy per sample. Fitted by least squares
        // to N samples, the cosine and the sine of a line each get a variance of 2/N times that.
        4.0 * self.background(bin) / (self.window_energy * samples as f64)
    }

    /// Returns false for most bins that [`LEAST_RATIO`] excludes. It counts, which is faster than a median.
    fn may_stand_out(&self, bin: usize) -> bool {
        let least = self.power[bin] * LN_2 / LEAST_RATIO * (1.0 + 1e-9);
        let is_above = |powers: &[f64]| {
            let below = powers.iter().filter(|&&power| power < least).count();
            powers.is_empty() || below > powers.len() / 2
        };
        self.beside(bin, BACKGROUND_CELLS).into_iter().all(is_above)
    }

    /// Returns the bins to the left and to the right of `bin`, `cells` cells on each side.
    fn beside(&self, bin: usize, cells: f64) -> [&[f64]; 2] {
        let per_cell = self.cell_hz / self.step_hz;
        let bins = |cells: f64| (cells * per_cell).round() as usize;
        let (near, far) = (bins(GUARD_CELLS), bins(GUARD_CELLS + cells));
        let end = self.power.len();
        let left = bin.saturating_sub(far).max(1).min(bin)..bin.saturating_sub(near).max(1);
        let right = (bin + near + 1).min(end)..(bin + far + 1).min(end);
        [&self.power[left], &self.power[right]]
    }

    /// Returns the mean power of noise around a bin: the largest of the estimates to the left, to the right and close
    /// by.
    fn background(&self, bin: usize) -> f64 {
        let [left, right] = self.beside(bin, BACKGROUND_CELLS);
        let close = self.beside(bin, CLOSE_CELLS).concat();
        // The median of an exponential distribution is ln 2 of its mean.
        let mean = |powers: &[f64]| upper_median(powers).map_or(0.0, |median| median / LN_2);
        let background = mean(left).max(mean(right)).max(mean(&close));
        background.max(self.floor).max(f64::MIN_POSITIVE)
    }

    /// Returns the position of the maximum of a parabola through three levels, in steps from `bin`.
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
    /// The last window. It is kept because the recordings of a set mostly have the same length.
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
