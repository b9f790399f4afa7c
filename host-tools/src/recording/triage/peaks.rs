//! Clipping that a filter, a resampling or a noise has rounded: no sample stands at the limit any more, but peaks still
//! end there, whatever the level around them is.

use super::verdict::Verdict;
use crate::dsp::sums::{Moments, extremes_inlined, sum_of};
use crate::dsp::wide;

/// Samples of a part: 10 ms.
const PART: usize = 50;

/// Share of the highest peaks that is left out of account, because rounding overshoots: one part in 200, at least two.
const OVERSHOOT_PARTS: usize = 200;

/// Peaks above this share of the limit end at it.
const AT_LIMIT: f64 = 0.85;

/// Peaks above this share of the limit are high.
const HIGH: f64 = 0.5;

/// Fewest parts with a peak at the limit.
const LEAST_PARTS: usize = 12;

/// Share of the high peaks that end at the limit. In real recordings with [`LEAST_PARTS`] or more it is at most 0.20,
/// because high peaks are rarer the higher they are.
const SHARE_OF_HIGH: f64 = 0.36;

/// The same, if this share of all parts has a peak at the limit; in real recordings that is at most 0.06.
const SHARE_OF_MANY: f64 = 0.34;
const MANY_PARTS: f64 = 0.12;

/// Ratio of the RMS of the loud to that of the quiet among the parts whose peak is at the limit, each a tenth of them.
///
/// It is 1.4 to 2.5 in real takes that were clipped. In a tone, or in steady noise of a bounded distribution, peaks end
/// alike without clipping; there it is below 1.25, and nothing can be said.
const LEVEL_RATIO: f64 = 1.4;

/// Returns the verdict on the axis with the largest share of peaks at a limit; none if the file itself `is_clipped`.
/// The axes come with their moments.
pub(super) fn clipped_before(
    (axes, moments): (&[Vec<f64>], &[Moments]),
    is_clipped: bool,
) -> Option<Verdict> {
    if is_clipped {
        return None;
    }
    let found = axes.iter().zip(moments).flat_map(|(axis, moments)| {
        let parts = parts(axis, moments.mean);
        let above: Vec<_> = parts.iter().map(|part| (part.highest, part.rms)).collect();
        let below: Vec<_> = parts.iter().map(|part| (-part.lowest, part.rms)).collect();
        [limit(&above), limit(&below)]
    });
    let (share, level_m_s2) = found.flatten().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Verdict::ClippedBefore { level_m_s2, share })
}

/// A part of an axis about the axis's mean.
struct Part {
    lowest: f64,
    highest: f64,
    rms: f64,
}

/// The parts of `axis`, whose mean is `mean`.
fn parts(axis: &[f64], mean: f64) -> Vec<Part> {
    wide(
        #[inline(always)]
        || {
            let parts = axis.chunks_exact(PART).map(|part| {
                let (low, high) = extremes_inlined(part);
                let energy = sum_of(part, |x| (x - mean) * (x - mean));
                Part {
                    lowest: low - mean,
                    highest: high - mean,
                    rms: (energy / PART as f64).sqrt(),
                }
            });
            parts.collect()
        },
    )
}

/// Returns the share of parts with a peak at the limit, and the limit, if there is one, of the peak and the RMS of each
/// part.
fn limit(measured: &[(f64, f64)]) -> Option<(f64, f64)> {
    let count = measured.len();
    if count < 4 * LEAST_PARTS {
        return None;
    }
    let mut peaks: Vec<f64> = measured.iter().map(|part| part.0).collect();
    let rank = count - (count / OVERSHOOT_PARTS).max(2) - 1;
    let (_, &mut limit, _) = peaks.select_nth_unstable_by(rank, f64::total_cmp);
    let above = |share: f64| move |part: &&(f64, f64)| part.0 >= share * limit;
    let number = |share: f64| measured.iter().filter(above(share)).count();
    let (at_limit, high) = (number(AT_LIMIT), number(HIGH));
    let share = at_limit as f64 / count as f64;
    let of_high = at_limit as f64 / high.max(1) as f64;
    let many = share >= MANY_PARTS && of_high >= SHARE_OF_MANY;
    if limit <= 0.0 || at_limit < LEAST_PARTS || (of_high < SHARE_OF_HIGH && !many) {
        return None;
    }
    let limited = measured.iter().filter(above(AT_LIMIT));
    let mut levels: Vec<f64> = limited.map(|part| part.1).collect();
    levels.sort_by(f64::total_cmp);
    let tenth = at_limit / 10;
    (levels[at_limit - 1 - tenth] > LEVEL_RATIO * levels[tenth]).then_some((share, limit))
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, tone};
    use super::*;
    use crate::dsp::sums::moments;

    fn clipped_before(axes: &[Vec<f64>], is_clipped: bool) -> Option<Verdict> {
        let moments: Vec<_> = axes.iter().map(|axis| moments(axis)).collect();
        super::clipped_before((axes, &moments), is_clipped)
    }

    /// Noise whose level varies by 12 dB.
    fn uneven() -> Vec<f64> {
        let slow = tone(1.5, 1.0).zip(tone(0.4, 1.0));
        let swell = slow.map(|(a, b)| (0.7 * (a + b)).exp());
        let bells = noise(1)
            .into_iter()
            .zip(noise(2))
            .zip(noise(3))
            .map(|((a, b), c)| a + b + c);
        bells.zip(swell).map(|(x, level)| x * level).collect()
    }

    #[test]
    fn clipping_shows_after_it_is_smoothed_and_uneven_noise_is_not_clipped() {
        let clean = uneven();
        assert_eq!(clipped_before(std::slice::from_ref(&clean), false), None);
        assert_eq!(clipped_before(&[noise(4)], false), None);
        assert_eq!(clipped_before(&[tone(100.0, 1.0).collect()], false), None);
        let smoothed: Vec<f64> = clean
            .iter()
            .map(|x| x.clamp(-2.0, 2.0))
            .zip(noise(5))
            .map(|(x, n)| x + 0.03 * n)
            .collect();
        assert!(clipped_before(&[smoothed], false).is_some());
    }
}
