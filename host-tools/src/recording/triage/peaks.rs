//! Clipping that a filter, a resampling or a noise has rounded: no sample stands at the limit any more, but peaks still
//! end there, whatever the level around them is.

use super::verdict::Verdict;
use crate::dsp::sums::{extremes, mean, sum_of};

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
pub(super) fn clipped_before(axes: &[Vec<f64>], is_clipped: bool) -> Option<Verdict> {
    if is_clipped {
        return None;
    }
    let found = axes
        .iter()
        .flat_map(|axis| [limit(axis, 1.0), limit(axis, -1.0)]);
    let (share, level_m_s2) = found.flatten().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Verdict::ClippedBefore { level_m_s2, share })
}

/// Returns the share of parts with a peak at the limit on the side of `sign`, and the limit, if there is one.
fn limit(axis: &[f64], sign: f64) -> Option<(f64, f64)> {
    let mean = mean(axis);
    let parts = axis.chunks_exact(PART);
    // Peak and RMS of each part.
    let mut measured: Vec<(f64, f64)> = parts
        .map(|part| {
            let (low, high) = extremes(part);
            let peak = if sign > 0.0 { high - mean } else { mean - low };
            let energy = sum_of(part, |x| (x - mean) * (x - mean));
            (peak, (energy / PART as f64).sqrt())
        })
        .collect();
    let count = measured.len();
    if count < 4 * LEAST_PARTS {
        return None;
    }
    measured.sort_by(|a, b| a.0.total_cmp(&b.0));
    let limit = measured[count - (count / OVERSHOOT_PARTS).max(2) - 1].0;
    let above = |share: f64| count - measured.partition_point(|part| part.0 < share * limit);
    let (at_limit, high) = (above(AT_LIMIT), above(HIGH));
    let share = at_limit as f64 / count as f64;
    let of_high = at_limit as f64 / high.max(1) as f64;
    let many = share >= MANY_PARTS && of_high >= SHARE_OF_MANY;
    let is_limited = limit > 0.0 && at_limit >= LEAST_PARTS && (of_high >= SHARE_OF_HIGH || many);
    let mut levels: Vec<f64> = measured[count - at_limit..]
        .iter()
        .map(|part| part.1)
        .collect();
    levels.sort_by(f64::total_cmp);
    let tenth = at_limit / 10;
    let varies = || levels[at_limit - 1 - tenth] > LEVEL_RATIO * levels[tenth];
    (is_limited && varies()).then_some((share, limit))
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, tone};
    use super::*;

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
