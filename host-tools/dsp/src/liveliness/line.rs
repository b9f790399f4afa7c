//! The strongest narrow line of a signal, and its level over time.

use super::{centred, median};
use crate::spectrum::PowerSpectrum;

/// Lowest frequency of a line, Hz, and highest frequency as a fraction of the sample rate.
const LOWEST_HZ: f64 = 10.0;
const HIGHEST_SHARE: f64 = 0.44;

/// Longest segment of the spectrum in which lines are sought, s.
const SEGMENT_S: f64 = 1.0;

/// Shortest segment that can distinguish a line from a resonance, s.
const SHORTEST_SEGMENT_S: f64 = 0.4;

/// Least ratio of the power of a line's bin to the median of the bins around it. In one periodogram of noise, the
/// highest of 2000 bins reaches this ratio once in a million times.
const OVER_MEDIAN: f64 = 31.6;

/// Least ratio of the power of a line's bin to the mean of its near neighbours outside the window's main lobe. A
/// resonance that is wider than 3 bins does not reach it.
const OVER_NEIGHBOURS: f64 = 10.0;

/// Duration of a window of the line's levels, s.
const WINDOW_S: f64 = 0.5;

/// Half the width of the band that contains a line in such a window, Hz: the main lobe of a Hann window plus one bin.
const HALF_BAND_HZ: f64 = 6.0;

/// Largest distance at which a line of another signal counts as the same line, as a fraction of its frequency, and a
/// lower bound of this distance in Hz.
const SAME_SHARE: f64 = 0.03;
const SAME_HZ: f64 = 4.0;

/// Least level, as a fraction of the highest level: a line that ends falls by 60 dB and no further.
const FLOOR: f64 = 1e-6;

/// Returns the frequency of the strongest narrow line of a signal in blocks, Hz; `None` if there is no line, or a block
/// is shorter than 0.4 s.
pub fn strongest_line_hz(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let centred = centred(blocks)?;
    let blocks: Vec<&[f64]> = centred.iter().map(Vec::as_slice).collect();
    let bins = &Bins::of(&blocks, rate_hz)?;
    let first = (LOWEST_HZ / bins.step_hz).ceil() as usize;
    let last = (HIGHEST_SHARE * rate_hz / bins.step_hz) as usize;
    let is_line = |&bin: &usize| {
        let here = bins.power(bin);
        let around = |near: usize, far: usize| {
            let left = bin.saturating_sub(far)..bin.saturating_sub(near - 1);
            let right = bin + near..=bin + far;
            left.chain(right).map(|bin| bins.power(bin))
        };
        // The main lobe of the Hann window reaches two bins from the line, which is up to half a bin beside `bin`.
        let neighbours = around(4, 6).sum::<f64>() / 6.0;
        here >= bins.power(bin + 1)
            && here >= bins.power(bin - 1)
            && here > OVER_NEIGHBOURS * neighbours
            && here > OVER_MEDIAN * median(around(4, 40)).unwrap_or(0.0)
    };
    let strongest = (first.max(1)..=last)
        .filter(is_line)
        .max_by(|a, b| bins.power(*a).total_cmp(&bins.power(*b)))?;
    Some(bins.centre_hz(strongest)).filter(|_| bins.power(strongest) > 0.0)
}

/// Returns the range of the levels, dB, of the line near `near_hz` over windows of 0.5 s that overlap by half; `None`
/// if there are fewer than two windows or a block is shorter than 0.4 s. If there is no line, it is the range of the
/// signal's level in the band there.
pub(super) fn range_db(blocks: &[&[f64]], rate_hz: f64, near_hz: f64) -> Option<f64> {
    let line_hz = Bins::of(blocks, rate_hz)?.strongest_near(near_hz);
    let window = (WINDOW_S * rate_hz).round() as usize;
    let windows = blocks
        .iter()
        .filter(|block| block.len() >= window)
        .flat_map(|block| block.windows(window).step_by((window / 2).max(1)));
    let powers: Vec<f64> = windows
        .map(|part| {
            PowerSpectrum::of_blocks(&[part], window, rate_hz)
                .power_between(line_hz - HALF_BAND_HZ, line_hz + HALF_BAND_HZ)
        })
        .collect();
    let highest = powers.iter().copied().fold(0.0, f64::max);
    let lowest = powers.iter().copied().fold(highest, f64::min);
    let range_db = 10.0 * (highest / lowest.max(FLOOR * highest)).log10();
    (powers.len() >= 2)
        .then_some(range_db)
        .filter(|range| range.is_finite())
}

/// A power spectrum that is read by bins.
struct Bins {
    spectrum: PowerSpectrum,
    step_hz: f64,
}

impl Bins {
    /// Computes the spectrum with segments as long as the shortest block, up to 1 s; `None` if that block is shorter
    /// than 0.4 s.
    fn of(blocks: &[&[f64]], rate_hz: f64) -> Option<Self> {
        let shortest = blocks.iter().map(|block| block.len()).min()?;
        let segment = shortest.min((SEGMENT_S * rate_hz).round() as usize);
        (segment as f64 >= SHORTEST_SEGMENT_S * rate_hz).then(|| Self {
            spectrum: PowerSpectrum::of_blocks(blocks, segment, rate_hz),
            step_hz: rate_hz / segment as f64,
        })
    }

    fn power(&self, bin: usize) -> f64 {
        let centre_hz = bin as f64 * self.step_hz;
        let half_hz = self.step_hz / 2.0;
        self.spectrum.power_between(centre_hz - half_hz, centre_hz + half_hz)
    }

    /// Returns the centre of power in a line's main lobe, Hz.
    fn centre_hz(&self, bin: usize) -> f64 {
        let lobe = bin.saturating_sub(2)..=bin + 2;
        let (mut sum, mut moment) = (0.0, 0.0);
        for bin in lobe {
            let power = self.power(bin);
            sum += power;
            moment += power * bin as f64;
        }
        let centre = moment / sum;
        // Bins without power have no centre.
        let bin = if centre.is_finite() { centre } else { bin as f64 };
        bin * self.step_hz
    }

    /// Returns the frequency of the strongest bin near a frequency, refined to the centre of its main lobe, Hz.
    fn strongest_near(&self, near_hz: f64) -> f64 {
        let half_hz = SAME_HZ.max(SAME_SHARE * near_hz);
        let bin = |hz: f64| (hz.max(0.0) / self.step_hz).round() as usize;
        let around = bin(near_hz - half_hz)..=bin(near_hz + half_hz);
        let strongest = around.max_by(|a, b| self.power(*a).total_cmp(&self.power(*b)));
        self.centre_hz(strongest.unwrap_or(bin(near_hz)))
    }
}
