//! Fits to a part of each recording: every other block is fitted, and the others are kept to judge the fit.
//!
//! Blocks alternate, because a recording changes over time: halves would compare its beginning with its end. Lags are
//! estimated within blocks and averaged, never across the join of two blocks. Only these come from the whole recording:
//! the direction of the first principal component, the mean, the verdicts of triage, the choice of the high-pass
//! filter, the rig's noise and the signal without it, the wavelengths of lines with the course of the speed, whether a
//! residual has impulses and a changing level, and how loud the loudest moments are.

use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;

/// Longest block, s. Blocks of 1 s resolve the lowest third octave; shorter ones alternate more often.
const LONGEST_BLOCK_S: f64 = 1.0;

/// Shortest block when a recording is divided into four, s. A shorter recording is divided into halves.
const SHORTEST_BLOCK_S: f64 = 0.4;

/// Division of a recording into an even number of blocks of equal length. The first, third and so on are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    count: usize,
    len: usize,
}

impl Blocks {
    /// Divides a recording of `samples` samples at 5 kHz into an even number of equal blocks of at most 1 s: four or
    /// more, or two if four would be shorter than 0.4 s each. The remainder of the division is not used.
    pub fn of(samples: usize) -> Self {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let duration_s = samples as f64 / rate_hz;
        let count = if duration_s < 4.0 * SHORTEST_BLOCK_S {
            2
        } else {
            // An even number, so that both parts are equal.
            (2 * (duration_s / (2.0 * LONGEST_BLOCK_S)).ceil() as usize).max(4)
        };
        Self {
            count,
            len: samples / count,
        }
    }

    /// Duration of a block, s.
    pub fn block_s(&self) -> f64 {
        self.len as f64 / f64::from(SAMPLE_RATE_HZ)
    }

    /// Returns the samples of each block that is fitted.
    pub fn fitted(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        self.every_other(0)
    }

    /// Returns the samples of each block that is kept for judging.
    pub fn judged(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        self.every_other(1)
    }

    fn every_other(&self, first: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let len = self.len;
        (first..self.count)
            .step_by(2)
            .map(move |block| block * len..(block + 1) * len)
    }
}

/// The part of a recording that is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    Whole,
    /// Every other block; see [`Blocks`].
    Blocks,
}

impl Part {
    /// Returns the ranges of samples that are fitted, of `samples` samples.
    pub(super) fn of(self, samples: usize) -> Vec<Range<usize>> {
        match self {
            Self::Whole => std::iter::once(0..samples).collect(),
            Self::Blocks => Blocks::of(samples).fitted().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::estimate::{KnownBand, estimate, estimate_of};
    use proptest::prelude::*;
    use stylus_dsp::autocorrelation::PaddedSpectrum;

    /// Estimates the autocorrelation of a signal from lag 0 to `max_lag`, (m/s²)², as the mean over its blocks,
    /// weighted by their lengths.
    fn lags_of_blocks(blocks: &[&[f64]], max_lag: usize) -> Vec<f64> {
        estimate_of(SAMPLE_RATE_HZ, blocks, max_lag, KnownBand::default()).lags
    }

    proptest! {
        #[test]
        fn both_parts_are_equal_and_share_no_sample(samples in 0usize..200_000) {
            let blocks = Blocks::of(samples);
            let (fitted, judged): (Vec<_>, Vec<_>) = (blocks.fitted().collect(), blocks.judged().collect());
            prop_assert_eq!(fitted.len(), judged.len());
            let mut all: Vec<_> = fitted.iter().chain(&judged).cloned().collect();
            all.sort_by_key(|block| block.start);
            prop_assert!(all.windows(2).all(|pair| pair[0].end == pair[1].start));
            prop_assert_eq!(all[0].start, 0);
            let end = all[all.len() - 1].end;
            prop_assert!(end <= samples && samples - end < all.len());
        }

        #[test]
        fn blocks_are_of_half_a_second_to_a_second(samples in 10_000usize..200_000) {
            let block_s = Blocks::of(samples).block_s();
            prop_assert!((0.499..=1.0).contains(&block_s), "{}", block_s);
        }

        /// The samples of blocks that are kept for judging do not influence the lags.
        #[test]
        fn lags_do_not_depend_on_what_is_left_for_judging(seed in 0u64..1000) {
            let signal = test_helpers::noise(seed, 10_000);
            let blocks = Blocks::of(signal.len());
            let mut other = signal.clone();
            for block in blocks.judged() {
                other[block].fill(1e3);
            }
            let lags = |signal: &[f64]| {
                let fitted: Vec<&[f64]> = blocks.fitted().map(|block| &signal[block]).collect();
                lags_of_blocks(&fitted, 50)
            };
            prop_assert_eq!(lags(&signal), lags(&other));
        }
    }

    /// The fit that blocks judge is the fit that was asked for, including its leakage.
    #[test]
    fn a_block_is_estimated_as_a_recording_is() {
        // Noise that falls by 12 dB per octave, so that a rectangular window leaks.
        let (mut velocity, mut place) = (0.0, 0.0);
        let signal: Vec<f64> = (0..5000u32)
            .map(|n| {
                velocity = 0.999 * velocity + f64::from(n * n % 7919) / 3959.5 - 1.0;
                place = 0.999 * place + velocity;
                place
            })
            .collect();
        let plain = PaddedSpectrum::of(&signal, 50);
        let rectangular = plain.lags();
        let whole = estimate(SAMPLE_RATE_HZ, &signal, plain, KnownBand::default()).lags;
        assert_eq!(lags_of_blocks(&[&signal], 50), whole);
        assert_eq!(whole, PaddedSpectrum::tapered(&signal, 50).lags());
        assert_ne!(whole, rectangular);
    }

    #[test]
    fn a_recording_of_the_papers_length_has_two_blocks_of_half_a_second_per_part() {
        let blocks = Blocks::of(10_000);
        assert_eq!(blocks.fitted().collect::<Vec<_>>(), [0..2500, 5000..7500]);
        assert_eq!(blocks.judged().collect::<Vec<_>>(), [2500..5000, 7500..10_000]);
        let (fitted, judged) = (0..1500, 1500..3000);
        assert_eq!(Blocks::of(3000).fitted().next(), Some(fitted));
        assert_eq!(Blocks::of(3000).judged().next(), Some(judged));
        assert_eq!(Blocks::of(3000).judged().count(), 1);
    }
}
