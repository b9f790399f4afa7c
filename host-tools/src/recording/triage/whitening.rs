//! Whitening of a recording by its own linear predictor, and what of it is kept for comparisons.

use std::ops::Range;

use crate::dsp::linear_prediction::{Prediction, corrected, step_up};
use crate::dsp::sums::{dot, dot_inlined};
use crate::dsp::wide;

/// Order of the predictor that whitens.
const ORDER: usize = 16;

/// Least share of a signal's energy that its predictor leaves; 16-bit round-off of a tone leaves 10⁻¹⁰.
const LEAST_RESIDUAL: f64 = 1e-8;

/// The smoothing: binomial.
const SMOOTHING: [f64; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];

/// Past of the predictor and of the smoothing, in samples.
pub(super) const PAST: usize = ORDER + SMOOTHING.len();

/// Parts of a recording whose energies are known.
const PARTS: usize = 16;

/// Share of the parts that two recordings have in common of which the strongest are compared first: one in so many.
const COMPARED_PARTS: usize = 4;

/// The filter that whitens a recording, and where its whitened signal is strong.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Whitening {
    /// Predictor and smoothing in one filter, the weight of the present sample first; none for a signal that is
    /// predictable.
    filter: Vec<f64>,
    /// Samples of a part; the parts begin behind the filter's past.
    part: usize,
    /// Energy of each part of the whitened signal, and of the rest behind the last part.
    energies: [f64; PARTS + 1],
}

/// A stretch of a whitened signal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Its samples.
    pub range: Range<usize>,
    /// Its share of the energy, or less.
    pub share: f64,
}

impl Whitening {
    /// The whitening of `signal`, and `signal` whitened.
    pub fn of(signal: &[f32]) -> (Self, Vec<f32>) {
        let filter = filter_of(signal);
        let whitened = filtered(signal, &filter);
        let mut whitening = Self {
            filter,
            part: whitened.len().saturating_sub(PAST) / PARTS,
            energies: [0.0; PARTS + 1],
        };
        for part in 0..=PARTS {
            let samples = whitened.get(whitening.range(part, whitened.len()));
            let samples = samples.unwrap_or_default();
            whitening.energies[part] = dot(samples, samples);
        }
        (whitening, whitened)
    }

    fn begin(&self, part: usize) -> usize {
        PAST + part * self.part
    }

    /// Samples of a part, or of the rest of `length` samples.
    fn range(&self, part: usize, length: usize) -> Range<usize> {
        let end = if part == PARTS {
            length
        } else {
            self.begin(part + 1)
        };
        self.begin(part)..end
    }

    /// The strongest quarter of whole parts `within` a range of samples, with its least share of the energy in `all` of
    /// a range around it; none if no part is within.
    pub fn strongest(&self, within: &Range<usize>, all: &Range<usize>) -> Option<Stretch> {
        let is_within =
            |&part: &usize| self.begin(part) >= within.start && self.begin(part + 1) <= within.end;
        let first = (0..PARTS).find(is_within).filter(|_| self.part > 0)?;
        let end = (first..PARTS).take_while(is_within).last()? + 1;
        let count = (end - first).div_ceil(COMPARED_PARTS);
        let energy = |first: usize| self.energies[first..first + count].iter().sum::<f64>();
        let strongest = (first..=end - count).max_by(|&a, &b| energy(a).total_cmp(&energy(b)))?;
        let touched = (0..=PARTS).filter(|&part| {
            let range = self.range(part, usize::MAX);
            range.start < all.end && range.end > all.start
        });
        let around: f64 = touched.map(|part| self.energies[part]).sum();
        (around > 0.0).then(|| Stretch {
            range: self.begin(strongest)..self.begin(strongest + count),
            share: energy(strongest) / around,
        })
    }

    /// Returns whether the signal is predictable, so that nothing of it is left whitened.
    pub fn is_empty(&self) -> bool {
        self.filter.is_empty()
    }

    /// `signal` whitened by this filter; empty without one.
    pub fn whitened(&self, signal: &[f32]) -> Vec<f32> {
        filtered(signal, &self.filter)
    }

    /// The samples `range` of `signal` whitened, with the bits of [`Self::whitened`]; none if they go beyond the
    /// signal, or if the filter has no past there.
    pub fn part(&self, signal: &[f32], range: Range<usize>) -> Option<Vec<f32>> {
        let from = range.start.checked_sub(PAST)?;
        let mut part = filtered(signal.get(from..range.end)?, &self.filter);
        (part.len() >= PAST).then(|| part.split_off(PAST))
    }
}

/// Filter of the predictor of `signal` and of the smoothing; none for a signal that is predictable.
fn filter_of(signal: &[f32]) -> Vec<f64> {
    if signal.len() <= 2 * ORDER {
        return Vec::new();
    }
    let prediction = Prediction::levinson_durbin(&corrected(lags(signal)), ORDER);
    let left = prediction.error_power.last().copied().unwrap_or(0.0);
    if left <= LEAST_RESIDUAL * prediction.error_power[0]
        || !left.is_finite()
        || prediction.reflection.is_empty()
    {
        return Vec::new();
    }
    let predictor = step_up(&prediction.reflection);
    let mut filter = vec![0.0; predictor.len() + SMOOTHING.len()];
    for (lag, a) in std::iter::once(1.0).chain(predictor).enumerate() {
        for (sum, weight) in filter[lag..].iter_mut().zip(SMOOTHING) {
            *sum += a * weight / 16.0;
        }
    }
    filter
}

/// Sums of the products of `signal`, longer than [`ORDER`], with itself, from lag 0 to [`ORDER`].
fn lags(signal: &[f32]) -> Vec<f64> {
    wide(
        #[inline(always)]
        || {
            (0..=ORDER)
                .map(|lag| dot_inlined(&signal[..signal.len() - lag], &signal[lag..]))
                .collect()
        },
    )
}

/// `signal` through `filter`, whose first weight is that of the present sample; empty without a filter.
fn filtered(signal: &[f32], filter: &[f64]) -> Vec<f32> {
    /// Samples that are computed at once, in vector registers.
    const AT_ONCE: usize = 16;
    if filter.is_empty() {
        return Vec::new();
    }
    let past = filter.len() - 1;
    let mut padded = Vec::with_capacity(past + signal.len() + AT_ONCE);
    padded.resize(past, 0.0);
    padded.extend(signal.iter().map(|&x| f64::from(x)));
    padded.resize(past + signal.len().next_multiple_of(AT_ONCE), 0.0);
    let mut result = vec![0.0; signal.len().next_multiple_of(AT_ONCE)];
    wide(
        #[inline(always)]
        || {
            let (chunks, _) = result.as_chunks_mut::<AT_ONCE>();
            for (chunk, window) in chunks
                .iter_mut()
                .zip(padded.windows(past + AT_ONCE).step_by(AT_ONCE))
            {
                let mut sums = [0.0; AT_ONCE];
                for (weight, samples) in filter.iter().zip(window.windows(AT_ONCE).rev()) {
                    for (sum, x) in sums.iter_mut().zip(samples) {
                        *sum += weight * x;
                    }
                }
                for (to, sum) in chunk.iter_mut().zip(sums) {
                    *to = sum as f32;
                }
            }
        },
    );
    result.truncate(signal.len());
    result
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::noise;
    use super::*;

    fn single(signal: &[f64]) -> Vec<f32> {
        signal.iter().map(|&x| x as f32).collect()
    }

    /// The oracle is the filter's sum, for each sample alone.
    #[test]
    fn a_whitened_sample_is_the_sum_of_its_filter_to_the_bit() {
        for length in [33, 40, 100, 1001, 10_000] {
            let signal = single(&noise(1)[..length]);
            let (whitening, whitened) = Whitening::of(&signal);
            assert_eq!(whitened.len(), length);
            for (n, &x) in whitened.iter().enumerate() {
                let mut sum = 0.0;
                for (lag, weight) in whitening.filter.iter().enumerate() {
                    let before = n.checked_sub(lag).map_or(0.0, |at| f64::from(signal[at]));
                    sum += weight * before;
                }
                assert_eq!(x, sum as f32, "{n} of {length}");
            }
        }
    }

    #[test]
    fn a_part_is_that_of_the_whole_to_the_bit() {
        let signal = single(&noise(2));
        let (whitening, whitened) = Whitening::of(&signal);
        for range in [PAST..PAST + 1, 100..2603, 9_000..10_000] {
            let part = whitening.part(&signal, range.clone()).unwrap();
            assert_eq!(part, whitened[range]);
        }
        assert_eq!(whitening.part(&signal, PAST - 1..100), None);
        assert_eq!(whitening.part(&signal, 100..10_001), None);
    }

    /// The oracle is the energy of the whitened samples themselves.
    #[test]
    fn the_strongest_stretch_is_within_and_has_the_share_of_energy_that_is_said() {
        let mut signal = noise(3);
        signal[6000..7000].iter_mut().for_each(|x| *x *= 4.0);
        let (whitening, whitened) = Whitening::of(&single(&signal));
        let energy = |range: &Range<usize>| {
            let samples = whitened[range.clone()].iter();
            samples.map(|&x| f64::from(x) * f64::from(x)).sum::<f64>()
        };
        for within in [PAST..10_000, 500..9_000, 5_500..7_500, 100..2_000] {
            let all = (within.start - 20).max(PAST)..(within.end + 20).min(10_000);
            let found = whitening.strongest(&within, &all).unwrap();
            assert!(within.start <= found.range.start && found.range.end <= within.end);
            let share = energy(&found.range) / energy(&all);
            assert!(found.share <= share * (1.0 + 1e-12), "{found:?} {share}");
            assert!(found.share > 0.5 * share && found.share > 0.15, "{found:?}");
        }
        let loud = whitening
            .strongest(&(PAST..10_000), &(PAST..10_000))
            .unwrap();
        assert!(loud.range.contains(&6500), "{loud:?}");
        assert_eq!(whitening.strongest(&(100..600), &(0..700)), None);
        let (of_silence, nothing) = Whitening::of(&vec![0.0; 10_000]);
        assert!(of_silence.is_empty() && nothing.is_empty());
        assert_eq!(of_silence.strongest(&(0..10_000), &(0..10_000)), None);
    }
}
