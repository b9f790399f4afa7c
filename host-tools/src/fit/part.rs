//! Fits to a part of each recording, so that the rest can judge them: every other block is fitted, the others are left.
//!
//! Blocks alternate, because a recording changes over time: halves would compare its beginning with its end. Lags are
//! estimated within blocks and averaged, never across the join of two blocks. Nothing but the direction of the first
//! principal component, the mean, the verdicts of triage, the wavelengths of lines with the course of the speed, and
//! whether a residual has impulses and a level of its own comes from the whole recording.

use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;

use super::estimate::Bands;
use super::estimate::{Estimate, estimate};
use super::lines::{Lines, separate};
use super::options::Options;
use super::separated::{can_have_lines, of_texture};
use super::trial::{Analysis, Signal, analyse_with_signal};
use crate::dsp::autocorrelation::Autocorrelation;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::Result;
use crate::support::in_order::in_order;

/// Longest block, s. Blocks of 1 s resolve the lowest third octave; shorter ones alternate more often.
const LONGEST_BLOCK_S: f64 = 1.0;

/// Shortest block that a recording is divided into four for, s; a shorter recording is divided into halves.
const SHORTEST_BLOCK_S: f64 = 0.4;

/// Division of a recording into an even number of blocks of equal length, of which the first, third and so on are
/// fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    count: usize,
    len: usize,
}

impl Blocks {
    /// Divides a recording of so many samples at 5 kHz: into blocks of at most 1 s, two for each part at least; into
    /// halves if the blocks would be shorter than 0.4 s. At most one sample per block is left over at the end.
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

    /// Samples of each block that is fitted.
    pub fn fitted(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        self.every_other(0)
    }

    /// Samples of each block that is left for judging.
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

/// A trial of which a part was analysed.
#[derive(Clone, Debug)]
pub struct PartlyAnalysed {
    /// Statistics of the fitted blocks; verdicts and mean of the whole recording.
    pub analysis: Analysis,
    /// The whole reduced signal, without the lines that were taken out of the statistics.
    pub signal: Signal,
    /// Its division.
    pub blocks: Blocks,
}

/// Reads `trial` and analyses its fitted blocks for models of up to `max_order`.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn analyse_blocks(
    trial: &Trial,
    options: &Options,
    max_order: usize,
) -> Result<PartlyAnalysed> {
    let (mut analysis, signal) = analyse_with_signal(trial, options, max_order)?;
    let blocks = Blocks::of(signal.samples.len());
    let fitted = blocks.fitted().map(|block| &signal.samples[block]);
    let fitted: Vec<&[f64]> = fitted.collect();
    let estimate = estimate_of_blocks(&fitted, max_order, analysis.slow.cut_hz);
    (analysis.lags, analysis.bands) = (estimate.lags, estimate.bands);
    analysis.samples = fitted.iter().map(|block| block.len()).sum();
    analysis.power = analysis.lags[0];
    Ok(PartlyAnalysed {
        analysis,
        signal,
        blocks,
    })
}

/// As [`analyse_blocks`], of every trial of `set` for models of the highest order of `options`.
///
/// # Errors
/// The first trial that cannot be used.
pub fn analyse_blocks_of_set(
    set: &RecordingSet,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Vec<PartlyAnalysed>> {
    let max_order = options.order.highest();
    let mut analysed = in_order(&set.trials, |trial| {
        let analysed = analyse_blocks(trial, options, max_order);
        progress();
        analysed
    })?;
    if options.lines != Lines::None {
        for name in set.textures() {
            separate_lines(set, name, &mut analysed, options);
        }
    }
    Ok(analysed)
}

/// Takes the lines of texture `name` out of its trials' statistics and signals.
fn separate_lines(
    set: &RecordingSet,
    name: &str,
    analysed: &mut [PartlyAnalysed],
    options: &Options,
) {
    let (indices, trials) = of_texture(set, name);
    let speeds_mm_s: Vec<f64> = trials.iter().map(|trial| trial.line_speed_mm_s()).collect();
    let mut signals: Vec<Vec<f64>> = indices
        .iter()
        .zip(&trials)
        .map(|(&index, trial)| {
            let PartlyAnalysed {
                analysis, signal, ..
            } = &analysed[index];
            let is_sought = can_have_lines(trial, analysis, options);
            if is_sought {
                signal.samples.clone()
            } else {
                Vec::new()
            }
        })
        .collect();
    let fitted: Vec<Vec<Range<usize>>> = indices
        .iter()
        .map(|&index| analysed[index].blocks.fitted().collect())
        .collect();
    let shares = separate(&speeds_mm_s, &mut signals, Some(&fitted), options.lines);
    for (((index, rest), share), fitted) in indices.into_iter().zip(signals).zip(shares).zip(fitted)
    {
        let PartlyAnalysed {
            analysis, signal, ..
        } = &mut analysed[index];
        if share.amplitudes_m_s2.iter().flatten().any(|&a| a > 0.0) {
            let fitted: Vec<&[f64]> = fitted.into_iter().map(|block| &rest[block]).collect();
            let max_order = analysis.lags.len() - 1;
            let estimate = estimate_of_blocks(&fitted, max_order, analysis.slow.cut_hz);
            (analysis.lags, analysis.bands) = (estimate.lags, estimate.bands);
            signal.samples = rest;
        }
        analysis.lines = share;
    }
}

/// Estimates the autocorrelation of a signal from lag 0 to `max_lag`, (m/s²)², as the mean over its blocks, each
/// weighed by its length.
pub fn lags_of_blocks(blocks: &[&[f64]], max_lag: usize) -> Vec<f64> {
    estimate_of_blocks(blocks, max_lag, None).lags
}

fn estimate_of_blocks(blocks: &[&[f64]], max_lag: usize, cut_hz: Option<f64>) -> Estimate {
    let samples: usize = blocks.iter().map(|block| block.len()).sum();
    let estimates: Vec<(f64, Estimate)> = blocks
        .iter()
        .map(|block| {
            let weight = block.len() as f64 / samples.max(1) as f64;
            let plain = Autocorrelation::of(block, max_lag);
            (weight, estimate(block, plain, cut_hz))
        })
        .collect();
    let mut lags = vec![0.0; max_lag + 1];
    for (weight, estimate) in &estimates {
        for (sum, lag) in lags.iter_mut().zip(&estimate.lags) {
            *sum += weight * lag;
        }
    }
    let bands = Bands::mean(estimates.iter().map(|(weight, e)| (*weight, &e.bands)));
    Estimate { lags, bands }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::autocorrelation::Tapered;
    use proptest::prelude::*;

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

        /// Samples of the blocks that are judged have no influence on the lags.
        #[test]
        fn lags_do_not_depend_on_what_is_left_for_judging(seed in 0u64..1000) {
            let signal = crate::dsp::test_signals::noise(seed, 10_000);
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

    /// The fit that blocks judge is the one that was asked for, leakage and all.
    #[test]
    fn a_block_is_estimated_as_a_recording_is() {
        // Noise that falls by 12 dB per octave, which a rectangular window leaks from.
        let (mut velocity, mut place) = (0.0, 0.0);
        let signal: Vec<f64> = (0..5000u32)
            .map(|n| {
                velocity = 0.999 * velocity + f64::from(n * n % 7919) / 3959.5 - 1.0;
                place = 0.999 * place + velocity;
                place
            })
            .collect();
        let whole = estimate(&signal, Autocorrelation::of(&signal, 50), None).lags;
        assert_eq!(lags_of_blocks(&[&signal], 50), whole);
        assert_eq!(whole, Tapered::of(&signal, 50).into_autocorrelation().lags);
        assert_ne!(whole, Autocorrelation::of(&signal, 50).lags);
    }

    #[test]
    fn a_recording_of_the_papers_length_has_two_blocks_of_half_a_second_per_part() {
        let blocks = Blocks::of(10_000);
        assert_eq!(blocks.fitted().collect::<Vec<_>>(), [0..2500, 5000..7500]);
        assert_eq!(
            blocks.judged().collect::<Vec<_>>(),
            [2500..5000, 7500..10_000]
        );
        let (fitted, judged) = (0..1500, 1500..3000);
        assert_eq!(Blocks::of(3000).fitted().next(), Some(fitted));
        assert_eq!(Blocks::of(3000).judged().next(), Some(judged));
        assert_eq!(Blocks::of(3000).judged().count(), 1);
    }
}
