//! Power spectral density, by Welch's estimate.

use std::cell::{Cell, RefCell};
use std::f64::consts::TAU;
use std::rc::Rc;

use super::cost::add_dft_power;

/// Duration of a segment of Welch's estimate, s. It resolves the lowest third-octave band, which is 4.6 Hz wide.
const SEGMENT_S: f64 = 1.0;

/// Power spectral density of a signal.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerSpectrum {
    /// One-sided density, (signal's unit)²/Hz. Value k covers the frequencies that are nearer to k · `step_hz` than to
    /// any other multiple of `step_hz`.
    pub(super) density: Vec<f64>,
    pub(super) step_hz: f64,
    nyquist_hz: f64,
    worth_s: f64,
}

thread_local! {
    /// The last window, kept because the recordings of a set mostly have the same length.
    static HANN: RefCell<Rc<Hann>> = RefCell::new(Rc::new(Hann::of(0)));
}

/// A periodic Hann window.
struct Hann {
    weights: Vec<f64>,
    /// Sum of the squares of the weights.
    energy: f64,
    /// Overlaps in a block, for the most recent block length.
    overlaps: Cell<Overlaps>,
}

/// Weights with which the overlapping segments count the squared samples of a block.
#[derive(Clone, Copy, Default)]
struct Overlaps {
    /// Samples of the block.
    length: usize,
    /// Sum of the weights.
    weight: f64,
    /// Sum of the squared weights.
    squared_weight: f64,
}

impl Hann {
    fn of(length: usize) -> Self {
        let weights: Vec<f64> = (0..length)
            .map(|n| 0.5 - 0.5 * (TAU * n as f64 / length as f64).cos())
            .collect();
        Self {
            energy: weights.iter().map(|weight| weight * weight).sum(),
            weights,
            overlaps: Cell::default(),
        }
    }

    /// Returns the window of `length` samples. It is computed only if the last window had another length.
    fn last_or_of(length: usize) -> Rc<Self> {
        HANN.with_borrow_mut(|last| {
            if last.weights.len() != length {
                *last = Rc::new(Self::of(length));
            }
            Rc::clone(last)
        })
    }

    /// Returns the index of the first sample of each segment in a block of `length` samples, which holds at least one
    /// segment.
    fn begins(&self, length: usize) -> impl Iterator<Item = usize> + use<> {
        let segment = self.weights.len();
        let spare = length - segment;
        let hops = (2 * spare).div_ceil(segment);
        // A block of one segment has no hops.
        (0..=hops).map(move |hop| (spare * hop).checked_div(hops).unwrap_or(0))
    }

    /// Returns the overlaps in a block of `length` samples, which holds at least one segment.
    fn overlaps(&self, length: usize) -> Overlaps {
        let last = self.overlaps.get();
        if last.length == length {
            return last;
        }
        let mut weights = vec![0.0; length];
        for begin in self.begins(length) {
            for (sum, weight) in weights[begin..].iter_mut().zip(&self.weights) {
                *sum += weight * weight;
            }
        }
        let overlaps = Overlaps {
            length,
            weight: weights.iter().sum(),
            squared_weight: weights.iter().map(|w| w * w).sum(),
        };
        self.overlaps.set(overlaps);
        overlaps
    }
}

/// Returns the length, in samples, of the longest segment of an estimate, 1 s.
pub fn longest_segment(rate_hz: f64) -> usize {
    (SEGMENT_S * rate_hz).round() as usize
}

impl PowerSpectrum {
    /// Welch's estimate: the mean periodogram of Hann-windowed segments of 1 s, or of the whole signal if it is
    /// shorter. Segments overlap by half, or by slightly more so that the last one ends with the signal.
    ///
    /// The density is scaled by the window's energy, so that its integral is the power of a stationary signal. A signal
    /// of fewer than two samples has no power here, because a window of one sample is zero.
    pub fn welch(signal: &[f64], rate_hz: f64) -> Self {
        let segment = longest_segment(rate_hz).min(signal.len());
        Self::of_blocks(&[signal], segment, rate_hz)
    }

    /// Welch's estimate over several blocks of one signal, with segments of `segment` samples that lie within a block.
    /// Blocks shorter than a segment are left out.
    ///
    /// Two estimates with the same `segment` have the same resolution, so that the window's leakage is the same in
    /// both.
    pub fn of_blocks(blocks: &[&[f64]], segment: usize, rate_hz: f64) -> Self {
        let segment = segment.max(1);
        let window = Hann::last_or_of(segment);
        let (mut density, mut segments) = (vec![0.0; segment / 2 + 1], 0_u32);
        // Total weight of the samples in the estimate, from which its equivalent duration follows.
        let (mut weight, mut squared_weight) = (0.0, 0.0);
        for block in blocks.iter().filter(|block| block.len() >= segment && segment > 1) {
            for begin in window.begins(block.len()) {
                let windowed: Vec<f64> = block[begin..]
                    .iter()
                    .zip(&window.weights)
                    .map(|(value, weight)| value * weight)
                    .collect();
                add_dft_power(windowed, &mut density);
                segments += 1;
            }
            let overlaps = window.overlaps(block.len());
            weight += overlaps.weight;
            squared_weight += overlaps.squared_weight;
        }
        // The bins at both ends count double like all others, because half of their width lies outside the spectrum.
        let scale = 2.0 / (rate_hz * window.energy * f64::from(segments.max(1)));
        // No segment means no power, whatever the window's energy.
        let scale = if segments > 0 { scale } else { 0.0 };
        density.iter_mut().for_each(|value| *value *= scale);
        let worth = weight * weight / squared_weight / rate_hz;
        Self {
            density,
            step_hz: rate_hz / segment as f64,
            nyquist_hz: rate_hz / 2.0,
            worth_s: if worth.is_finite() { worth } else { 0.0 },
        }
    }

    /// Frequencies, Hz, and the one-sided density at each.
    pub fn densities(&self) -> impl Iterator<Item = (f64, f64)> {
        self.density
            .iter()
            .enumerate()
            .map(|(bin, density)| (bin as f64 * self.step_hz, *density))
    }

    /// Returns the equivalent number of independent averages in the power of Gaussian noise between two frequencies.
    /// The relative variance of this power is the inverse of that number. Returns 0 without an estimate, or if the
    /// range is empty.
    ///
    /// For a bandwidth B much wider than the resolution, the number is B (Σw)² / Σw² sample intervals, where w are the
    /// weights of the squared samples that result from the windows and their overlap (Welch, IEEE Trans. Audio
    /// Electroacoust. 15, 1967, 70). Bins of a Hann window that are one and two apart have correlations of 2/3 and 1/6
    /// in amplitude, which matter in a narrow band.
    pub fn averages_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let shares: Vec<f64> = self.shares(low_hz, high_hz).map(|(_, share)| share).collect();
        let at = |index: usize| shares.get(index).copied().unwrap_or(0.0);
        let (mut sum, mut variance) = (0.0, 0.0);
        for (index, share) in shares.iter().enumerate() {
            sum += share;
            let pairs = 4.0 / 9.0 * at(index + 1) + at(index + 2) / 36.0;
            variance += share * (share + 2.0 * pairs);
        }
        // One segment has the squares of a Hann window as weights. Its equivalent length is 18/35 of its length.
        let segments = self.worth_s * self.step_hz * 35.0 / 18.0;
        if variance > 0.0 {
            sum * sum / variance * segments
        } else {
            0.0
        }
    }

    /// Returns the density at `hz`, interpolated linearly between bins, in (signal's unit)²/Hz. Beyond the last bin,
    /// its density is returned.
    pub(super) fn density_at(&self, hz: f64) -> f64 {
        let place = hz / self.step_hz;
        let (before, share) = (place.floor() as usize, place.fract());
        let last = self.density.len() - 1;
        let [low, high] = [before, before + 1].map(|bin| self.density[bin.min(last)]);
        low + share * (high - low)
    }

    /// Returns this spectrum with other values at its frequencies.
    pub(super) fn with_density(&self, density: Vec<f64>) -> Self {
        Self { density, ..*self }
    }

    /// Returns the spectrum that is the fraction `share` of the way, in dB, from this spectrum to `other`. Both have
    /// the same segments.
    #[must_use]
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        let pairs = self.density.iter().zip(&other.density);
        let mean = |(own, other): (&f64, &f64)| own.powf(1.0 - share) * other.powf(share);
        self.with_density(pairs.map(mean).collect())
    }

    /// Returns the power between two frequencies, in (signal's unit)²: the integral of the density, with fractional
    /// bins at both ends.
    ///
    /// The first bin starts at 0 Hz and the last one ends at half the sample rate; there is no power beyond.
    pub fn power_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        self.shares(low_hz, high_hz)
            .map(|(index, share)| self.density[index] * share)
            .sum()
    }

    /// Returns each bin between two frequencies, with the width of its part that lies between them, Hz.
    fn shares(&self, low_hz: f64, high_hz: f64) -> impl Iterator<Item = (usize, f64)> {
        let (low, high) = (low_hz.max(0.0), high_hz.min(self.nyquist_hz));
        let step_hz = self.step_hz;
        let first = (low / step_hz).round() as usize;
        (first..self.density.len())
            .map(move |index| {
                let (begin, end) = ((index as f64 - 0.5) * step_hz, (index as f64 + 0.5) * step_hz);
                (index, begin, end.min(high) - begin.max(low))
            })
            .take_while(move |(_, begin, _)| *begin < high)
            .map(|(index, _, share)| (index, share.max(0.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, close};
    use super::*;
    use proptest::prelude::*;
    use test_helpers::noise;

    proptest! {
        #[test]
        fn the_welch_density_of_one_segment_keeps_the_windowed_energy(len in 2usize..600, seed: u64) {
            let signal = noise(seed, len);
            let hann = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / len as f64).cos();
            let (mut energy, mut window_energy) = (0.0, 0.0);
            for (n, x) in signal.iter().enumerate() {
                energy += (hann(n) * x).powi(2);
                window_energy += hann(n).powi(2);
            }
            let power = PowerSpectrum::welch(&signal, RATE_HZ).power_between(0.0, RATE_HZ / 2.0);
            prop_assert!(close(power, energy / window_energy, 1e-12));
        }

        #[test]
        fn the_estimate_of_blocks_of_one_segment_is_the_mean_of_theirs(seed: u64, count in 1usize..5) {
            let blocks: Vec<Vec<f64>> = (0..count as u64).map(|n| noise(seed ^ n, 400)).collect();
            let blocks: Vec<&[f64]> = blocks.iter().map(Vec::as_slice).collect();
            let power = |blocks: &[&[f64]]| PowerSpectrum::of_blocks(blocks, 400, RATE_HZ).power_between(100.0, 900.0);
            let mean = blocks.iter().map(|block| power(&[block])).sum::<f64>() / count as f64;
            prop_assert!(close(power(&blocks), mean, 1e-12));
        }

        #[test]
        fn power_is_the_sum_over_any_division_of_the_frequencies(
            len in 100usize..600, seed: u64, mut cuts in prop::collection::vec(0.0..2500.0f64, 1..20),
        ) {
            let spectrum = PowerSpectrum::welch(&noise(seed, len), RATE_HZ);
            cuts.extend([0.0, 2500.0]);
            cuts.sort_by(f64::total_cmp);
            let sum: f64 = cuts.windows(2).map(|cut| spectrum.power_between(cut[0], cut[1])).sum();
            prop_assert!(close(sum, spectrum.power_between(-1.0, 1e9), 1e-12));
        }
    }

    #[test]
    fn the_power_of_noise_scatters_as_the_number_of_averages_says() {
        for (low_hz, high_hz, segment) in [(500.0, 700.0, 800), (100.0, 108.0, 1250), (200.3, 206.1, 800)] {
            let (mut squares, mut expected) = (0.0, 0.0);
            for seed in 0..600 {
                let signal = noise(seed, 5000);
                let blocks: Vec<&[f64]> = signal.chunks(1250).collect();
                let spectrum = PowerSpectrum::of_blocks(&blocks, segment, RATE_HZ);
                let power = spectrum.power_between(low_hz, high_hz) / ((high_hz - low_hz) / 2500.0);
                squares += (power - 1.0).powi(2) / 600.0;
                expected = 1.0 / spectrum.averages_between(low_hz, high_hz);
            }
            assert!(
                close(squares, expected, 0.25),
                "{low_hz}: {squares}, expected {expected}"
            );
        }
    }
}
