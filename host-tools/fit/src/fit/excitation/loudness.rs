//! Loudness of an excitation at the output: behind a node's filter, in the loudest windows of 1, 5 and 50 ms.
//!
//! A moment of a residual may be far louder than the signal at that moment. A click, a slip of a sensor or a step has
//! much power where the filter passes little, and in the original signal the filter cancels it sample by sample. But a
//! snippet that is played elsewhere keeps only the power and would sound at its full level. So the
//! residual is judged by the power that the filter is expected to make of it if its samples have independent signs: the
//! power of each millisecond decays like the square of the filter's impulse response. A residual is limited until its
//! loudest windows are no louder than those of the recordings.

use std::ops::Range;

use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::linear_prediction::{error_share, step_up};
use stylus_dsp::sums::{dot, mean_square, sliding};

use super::power::local_rms;

/// Number of samples in a millisecond.
const MILLISECOND: usize = model_format::SAMPLE_RATE_HZ as usize / 1000;

/// Lengths of the windows of which the loudest counts, ms.
const WINDOWS_MS: [usize; 3] = [1, 5, 50];

/// Milliseconds for which a filter's ringing is followed. The rest is treated as steady.
const RINGING_MS: usize = 100;

/// Width of the Hann window over which a level is measured for limiting, samples: 5 ms at half height.
const SMOOTHING: usize = 50;

/// Number of recordings of which one may be faulty.
const WRONG: usize = 8;

/// RMS of a signal's loudest windows of 1, 5 and 50 ms, relative to the whole signal's RMS.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Loudest(pub [f64; WINDOWS_MS.len()]);

impl Loudest {
    /// Returns the loudest windows of `samples`, leaving out the milliseconds with `flaws`. All are 0 in silence.
    pub fn of(samples: &[f64], flaws: &[Range<usize>]) -> Self {
        let clean = clean_milliseconds(samples.len(), flaws);
        let powers: Vec<f64> = powers(samples)
            .into_iter()
            .zip(clean)
            .filter(|(_, clean)| *clean)
            .map(|(power, _)| power)
            .collect();
        Self::of_powers(&powers, mean(&powers))
    }

    /// Returns the loudest windows of a signal with these mean squares of each millisecond, relative to the root of
    /// `power`.
    fn of_powers(powers: &[f64], power: f64) -> Self {
        Self(WINDOWS_MS.map(|window| {
            // A signal that is shorter than a window counts as a whole.
            let window = window.min(powers.len()).max(1);
            let first: f64 = powers.iter().take(window).sum();
            let pairs = powers.iter().skip(window).zip(powers);
            // A running sum, whose work does not depend on the window's length.
            let loudest = pairs
                .scan(first, |sum, (next, last)| {
                    *sum += next - last;
                    Some(*sum)
                })
                .fold(first, f64::max)
                / window as f64;
            if power > 0.0 { (loudest / power).sqrt() } else { 0.0 }
        }))
    }

    /// Returns the loudest windows and the RMS of an excitation behind a filter with these reflection coefficients,
    /// relative to the expected RMS there of noise with a mean square of 1. The excitation is circular, of an even
    /// number of samples, and has this `spectrum`.
    pub fn behind(spectrum: &[Complex<f64>], reflection: &[f64]) -> (Self, f64) {
        let heard = powers(&filtered(spectrum, &step_up(reflection)));
        let expected = 1.0 / error_share(reflection);
        (Self::of_powers(&heard, expected), (mean(&heard) / expected).sqrt())
    }

    /// Returns the loudness that seven eighths of `signals` do not exceed (of two to eight signals, all but one), so
    /// that an event in one of them does not count for the others.
    pub fn of_most(signals: &[Self]) -> Option<Self> {
        let few = signals.len().div_ceil(WRONG).min(signals.len() / 2);
        Self::at_rank(signals, signals.len().checked_sub(1 + few)?)
    }

    /// Returns the loudness that all of `signals` reach except the calmest eighth.
    pub fn of_least(signals: &[Self]) -> Option<Self> {
        Self::at_rank(signals, signals.len().saturating_sub(1) / WRONG)
    }

    fn at_rank(signals: &[Self], rank: usize) -> Option<Self> {
        let window = |index: usize| {
            let mut values: Vec<f64> = signals.iter().map(|signal| signal.0[index]).collect();
            values.sort_by(f64::total_cmp);
            values.get(rank).copied()
        };
        Some(Self([window(0)?, window(1)?, window(2)?]))
    }

    /// Returns each window `factor` times as loud.
    pub fn times(self, factor: f64) -> Self {
        Self(self.0.map(|level| factor * level))
    }

    /// Combines the windows of both by `of`: `f64::min` or `f64::max`.
    pub fn with(self, other: Self, of: fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|n| of(self.0[n], other.0[n])))
    }

    /// Returns the largest ratio of a window to that of `other`.
    pub fn over(self, other: Self) -> f64 {
        self.0
            .into_iter()
            .zip(other.0)
            .map(|(own, other)| own / other.max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max)
    }
}

/// The power at the output of a filter for an excitation's power, millisecond by millisecond.
pub(super) struct Ringing {
    /// Fraction of an impulse's power at the output in each millisecond after the impulse, the last one first.
    shares: Vec<f64>,
    /// Fraction that comes later.
    later: f64,
}

impl Ringing {
    /// Returns the ringing of a filter with these `reflection` coefficients.
    pub fn of(reflection: &[f64]) -> Self {
        let newest_last: Vec<f64> = step_up(reflection).into_iter().rev().collect();
        let order = newest_last.len();
        let mut response = vec![0.0; order];
        for n in 0..RINGING_MS * MILLISECOND {
            let impulse = if n == 0 { 1.0 } else { 0.0 };
            response.push(impulse - dot(&response[n..], &newest_last));
        }
        // The filter's power gain is Σ h² = 1 / Π (1 - k²), so all fractions add up to one.
        let unit = error_share(reflection) * MILLISECOND as f64;
        let mut shares = powers(&response[order..]);
        shares.iter_mut().for_each(|power| *power *= unit);
        shares.reverse();
        Self {
            later: (1.0 - shares.iter().sum::<f64>()).max(0.0),
            shares,
        }
    }

    /// Returns the loudest windows at the output, for a residual with these mean squares of each millisecond and this
    /// mean.
    fn loudest(&self, powers: &[f64], mean: f64) -> Loudest {
        // Nothing rings before the first millisecond.
        let mut before = vec![0.0; self.shares.len() - 1];
        before.extend_from_slice(powers);
        let mut heard = sliding(&before, &self.shares);
        heard.iter_mut().for_each(|power| *power += self.later * mean);
        Loudest::of_powers(&heard, mean)
    }

    /// Returns gains for the samples of `residual` that limit its level. The limit is the highest with which the
    /// loudest windows at the output, without those in `flaws`, are no louder than `most`; it is never below the median
    /// level. `None` if they are not louder without a limit.
    pub fn limit(&self, residual: &[f64], flaws: &[Range<usize>], most: Loudest) -> Option<Vec<f64>> {
        /// Halvings of the range in which the limit is searched.
        const HALVINGS: usize = 12;
        // What is in a flaw is played nowhere, so it may be loud.
        let clean = clean_milliseconds(residual.len(), flaws);
        let count = clean.iter().filter(|clean| **clean).count().max(1);
        let heard = |residual: &[f64]| {
            let powers: Vec<f64> = powers(residual)
                .into_iter()
                .zip(&clean)
                .map(|(power, clean)| if *clean { power } else { 0.0 })
                .collect();
            let mean = powers.iter().sum::<f64>() / count as f64;
            self.loudest(&powers, mean).over(most)
        };
        if heard(residual) <= 1.0 {
            return None;
        }
        let levels = local_rms(residual, SMOOTHING);
        let gains = |limit: f64| -> Vec<f64> { levels.iter().map(|level| (limit / level).min(1.0)).collect() };
        let limited = |limit: f64| heard(&product(residual, &gains(limit)));
        let mut sorted = levels.clone();
        sorted.sort_by(f64::total_cmp);
        // Levels span decades, so their logarithm is halved.
        let (mut low, mut high) = (sorted[sorted.len() / 2].ln(), sorted[sorted.len() - 1].ln());
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            if limited(middle.exp()) <= 1.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(gains(low.exp()))
    }
}

/// Returns the products of `samples` and `gains`.
pub(super) fn product(samples: &[f64], gains: &[f64]) -> Vec<f64> {
    samples.iter().zip(gains).map(|(x, gain)| x * gain).collect()
}

/// Returns the mean square of each whole millisecond of `samples`.
fn powers(samples: &[f64]) -> Vec<f64> {
    samples.chunks_exact(MILLISECOND).map(mean_square).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Returns for each whole millisecond of `samples` samples whether it is free of `flaws`.
fn clean_milliseconds(samples: usize, flaws: &[Range<usize>]) -> Vec<bool> {
    let mut clean = vec![true; samples / MILLISECOND];
    for flaw in flaws {
        let end = flaw.end.div_ceil(MILLISECOND).min(clean.len());
        clean[(flaw.start / MILLISECOND).min(end)..end].fill(false);
    }
    clean
}

/// Returns a circular excitation, by its `spectrum`, filtered by the all-pole filter of a predictor.
fn filtered(spectrum: &[Complex<f64>], predictor: &[f64]) -> Vec<f64> {
    let count = 2 * (spectrum.len() - 1);
    let mut whitening = vec![0.0; count];
    whitening[0] = 1.0;
    whitening[1..=predictor.len()].copy_from_slice(predictor);
    let whitening = fourier::forward(&mut whitening);
    let mut output: Vec<_> = spectrum
        .iter()
        .zip(whitening)
        .map(|(bin, whitening)| bin / (whitening * count as f64))
        .collect();
    fourier::inverse(&mut output, count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{near, noise};

    /// Poles at 200 Hz that ring for some milliseconds.
    const REFLECTION: [f64; 2] = [-0.95, 0.9];

    #[test]
    fn the_loudest_windows_are_found_and_flaws_are_none() {
        let mut signal = vec![0.0; 5000];
        signal[1000..1250].fill(1.0);
        signal[2000..2025].fill(2.0);
        let rms = ((250.0 + 100.0) / 5000.0f64).sqrt();
        let found = Loudest::of(&signal, &[]).0;
        for (found, expected) in found.into_iter().zip([2.0, 2.0, 1.0]) {
            near(found * rms, expected, 1e-9);
        }
        let flaw: Vec<Range<usize>> = std::iter::once(2000..2025).collect();
        let found = Loudest::of(&signal, &flaw).0;
        near(found[0], found[2], 1e-9);
        assert_eq!(Loudest::of(&[0.0; 500], &[]), Loudest([0.0; 3]));
    }

    #[test]
    fn one_loud_recording_of_eight_is_not_what_most_reach_and_a_calm_one_of_nine_not_what_all_do() {
        let all: Vec<Loudest> = (1..=8).map(|n| Loudest([f64::from(n); 3])).collect();
        assert_eq!(Loudest::of_most(&all), Some(Loudest([7.0; 3])));
        assert_eq!(Loudest::of_most(&all[..2]), Some(Loudest([1.0; 3])));
        assert_eq!(Loudest::of_most(&all[2..3]), Some(Loudest([3.0; 3])));
        assert_eq!(Loudest::of_least(&all), Some(Loudest([1.0; 3])));
        let nine = [&all[..], &all[7..]].concat();
        assert_eq!(Loudest::of_least(&nine), Some(Loudest([2.0; 3])));
        assert_eq!(Loudest::of_most(&[]), None);
        assert_eq!(Loudest::of_least(&[]), None);
    }

    /// Noise behind a filter, computed by the filter's own recursion.
    #[test]
    fn noise_behind_a_filter_has_the_loudness_that_the_recursion_gives_it() {
        let mut excitation = noise(1, 1 << 14);
        let a = step_up(&REFLECTION);
        let mut heard = vec![0.0; 2];
        for (n, x) in excitation.iter().enumerate() {
            heard.push(x - a[0] * heard[n + 1] - a[1] * heard[n]);
        }
        let expected = Loudest::of(&heard[2..], &[]);
        let (found, rms) = Loudest::behind(&fourier::forward(&mut excitation), &REFLECTION);
        near(rms, 1.0, 0.05);
        for (found, expected) in found.0.into_iter().zip(expected.0) {
            near(found / expected, 1.0, 0.05);
        }
    }

    #[test]
    fn a_filters_ringing_has_all_of_an_impulses_power() {
        let ringing = Ringing::of(&REFLECTION);
        let heard: f64 = ringing.shares.iter().sum();
        assert!(ringing.later < 1e-6, "{heard}");
        near(heard, 1.0, 1e-6);
        assert!(ringing.shares[RINGING_MS - 1] < 0.9, "it rings");
        assert_eq!(Ringing::of(&[]).shares[RINGING_MS - 1], 1.0);
    }

    #[test]
    fn a_burst_is_limited_to_the_loudness_allowed_and_nothing_else_is() {
        let mut residual = noise(2, 20_000);
        let ringing = Ringing::of(&REFLECTION);
        let most = Loudest([3.0, 2.2, 1.4]);
        assert_eq!(ringing.limit(&residual, &[], most), None);
        residual[9000..9020].iter_mut().for_each(|x| *x *= 100.0);
        let gains = ringing.limit(&residual, &[], most).unwrap();
        let limited = product(&residual, &gains);
        assert_eq!(ringing.limit(&limited, &[], most), None);
        let touched = gains.iter().filter(|gain| **gain < 0.9).count();
        assert!(gains[9010] < 0.1 && touched < 400, "{} {touched}", gains[9010]);
        // In a flaw the peak does not count.
        let flaw: Vec<Range<usize>> = std::iter::once(8900..9100).collect();
        assert_eq!(ringing.limit(&residual, &flaw, most), None);
    }
}
