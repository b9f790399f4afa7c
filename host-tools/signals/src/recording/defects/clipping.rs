//! Detection of clipping from the samples of a recording.

use std::ops::Range;

use super::Axis;

/// Least number of clipped samples that counts, because a single sample is not evidence in a short recording.
const MIN_CLIPPED_SAMPLES: usize = 8;

/// Least number of equal extreme samples in a row that are clipped: an unclipped signal reaches its extreme once, or
/// twice at the top of a slow wave.
const LEAST_RUN: usize = 3;

/// Returns the fraction of clipped samples on the worst axis.
///
/// `axes` must have the recording's own sample rate, because resampling rounds flat tops.
pub(super) fn clipped_share(axes: &[Axis<'_>]) -> f64 {
    axes.iter().map(clipped_share_of).fold(0.0, f64::max)
}

/// Returns the fraction of samples at the highest or lowest value, if at least eight of them begin [`LEAST_RUN`] equal
/// samples. A signal that has only one or two different values does not count as clipped.
fn clipped_share_of(axis: &Axis<'_>) -> f64 {
    let (samples, outside) = (axis.samples, axis.at_limits.len());
    if axis.low >= axis.high || outside < MIN_CLIPPED_SAMPLES || outside == samples.len() {
        return 0.0;
    }
    let flat = |run: &[f64]| run.iter().all(|x| (x - run[0]).abs() <= axis.tolerance);
    if axis
        .at_limits
        .iter()
        .map(|&at| at as usize)
        .filter(|&at| samples.get(at..at + LEAST_RUN).is_some_and(flat))
        .count()
        < MIN_CLIPPED_SAMPLES
    {
        return 0.0;
    }
    outside as f64 / samples.len() as f64
}

/// Largest ratio of half a range to the RMS about the mean, within which [`rounded_share`] looks: a sine's is 1.4, that
/// of Gaussian noise 4.
const MOST_CREST: f64 = 2.2;

/// Least number of tops on either side that show a limit, and largest number that is looked at, which bounds memory.
const LEAST_TOPS: usize = 40;
const MOST_TOPS: usize = 100_000;

/// Least height of nine tenths of the longer tops, as a fraction of the highest: 0.78 in a recording that lost 2.8 dB,
/// 0.6 in Gaussian noise.
const EQUAL_TOPS: f64 = 0.7;

/// Least median ratio of the lengths of successive tops. A sine's are alike.
const UNLIKE_LENGTHS: f64 = 1.4;

/// Returns the fraction of samples, on the worst axis, at tops that were clipped before a filter, which rounds them. A
/// surface's tops are the higher the longer they are; these are of one height, whatever their length.
pub(super) fn rounded_share(axes: &[Axis<'_>]) -> f64 {
    axes.iter().map(rounded_share_of).fold(0.0, f64::max)
}

fn rounded_share_of(axis: &Axis<'_>) -> f64 {
    let (middle, half) = (0.5 * (axis.low + axis.high), 0.5 * (axis.high - axis.low));
    let is_even = half > 0.0 && half < MOST_CREST * axis.deviation;
    // Of a few steps, the highest hold many samples of any signal.
    if !is_even || axis.least_step > 0.05 * half {
        return 0.0;
    }
    let height = |x: &f64| (x - middle) / half;
    if !are_of_one_height(axis.samples, height) || !are_of_one_height(axis.samples, |x| -height(x)) {
        return 0.0;
    }
    let at_tops = axis.samples.iter().filter(|x| height(x).abs() > EQUAL_TOPS).count();
    at_tops as f64 / axis.samples.len() as f64
}

/// Returns true if the longer tops of a signal are of one `height`, which is at most 1, and their lengths differ. A top
/// lasts as long as the signal is above zero, because noise crosses any level near a top.
fn are_of_one_height(samples: &[f64], height: impl Fn(&f64) -> f64) -> bool {
    let is_above = |x: &f64| height(x) > 0.0;
    let highest = |top: &&[f64]| top.iter().map(&height).fold(0.0, f64::max);
    let tops: Vec<&[f64]> = samples
        .chunk_by(|x, next| is_above(x) == is_above(next))
        .filter(|top| highest(top) > 0.5)
        .take(MOST_TOPS)
        .collect();
    if tops.len() < LEAST_TOPS {
        return false;
    }
    let at = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values[(share * values.len() as f64) as usize]
    };
    let lengths: Vec<f64> = tops.iter().map(|top| top.len() as f64).collect();
    let ratios = lengths
        .windows(2)
        .map(|pair| (pair[0] / pair[1]).max(pair[1] / pair[0]))
        .collect();
    let length = at(lengths, 0.5);
    let heights = tops.iter().filter(|top| top.len() as f64 >= length).map(highest);
    at(heights.collect(), 0.1) >= EQUAL_TOPS && at(ratios, 0.5) >= UNLIKE_LENGTHS
}

/// A stretch of samples that are clipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub seconds: f64,
}

/// Returns the runs of [`LEAST_RUN`] or more equal samples at the highest or lowest value of `axis`, in the order of
/// time; none if the signal has only one or two different values. A few runs do not make a recording clipped, but no
/// run comes from a surface.
pub(super) fn clips(axis: &Axis<'_>, rate_hz: f64) -> Vec<Clip> {
    let samples = axis.samples;
    if axis.low >= axis.high || axis.at_limits.len() == samples.len() {
        return Vec::new();
    }
    let equal = |at: usize| (samples[at] - samples[at + 1]).abs() <= axis.tolerance;
    // A run that begins away from the limits cannot be at a limit, so only samples at a limit are examined.
    let starts = axis
        .at_limits
        .iter()
        .map(|&at| at as usize)
        .filter(|&at| at == 0 || !equal(at - 1));
    let runs = starts.map(|start| {
        let mut end = start + 1;
        while end < samples.len() && equal(end - 1) {
            end += 1;
        }
        start..end
    });
    let clipped = runs.filter(|run| run.len() >= LEAST_RUN);
    let clip = |run: Range<usize>| Clip {
        start_s: run.start as f64 / rate_hz,
        seconds: run.len() as f64 / rate_hz,
    };
    clipped.map(clip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::noise;

    /// The mean of `width` samples.
    fn filtered(samples: &[f64], width: usize) -> Vec<f64> {
        samples
            .windows(width)
            .map(|near| near.iter().sum::<f64>() / width as f64)
            .collect()
    }

    #[test]
    fn tops_that_a_filter_rounded_are_found_and_those_of_textures_tones_and_sweeps_are_not() {
        let share = |samples: &[f64]| rounded_share(&[Axis::of(&filtered(samples, 4))]);
        for seed in 0..20 {
            let texture = filtered(&noise(seed, 20_000), 12);
            let clipped: Vec<f64> = texture.iter().map(|x| 9.81 + x.clamp(-0.28, 0.28)).collect();
            assert!(share(&clipped) > 0.2, "{seed}");
            assert_eq!(share(&texture), 0.0, "{seed}");
            for (sweep, depth) in [(0.0, 0.05), (0.0, 0.5), (1e-5, 0.05), (1e-5, 0.5)] {
                let tone = |(n, x): (usize, &f64)| (n as f64 * (0.03 + sweep * n as f64)).sin() + depth * x;
                let tone: Vec<f64> = texture.iter().enumerate().map(tone).collect();
                assert_eq!(share(&tone), 0.0, "{seed}, {sweep}, {depth}");
            }
        }
    }

    #[test]
    fn clipped_runs_are_found_where_they_are_and_a_signal_of_two_values_has_none() {
        let wave = |gain: f64| {
            move |n: u32| (gain * (0.05 * f64::from(n)).sin() + 0.1 * f64::from(n * n % 97) / 97.0).clamp(-1.0, 1.0)
        };
        let clean: Vec<f64> = (0..1000).map(wave(0.8)).collect();
        assert_eq!(clips(&Axis::of(&clean), 1000.0), []);
        let clipped: Vec<f64> = (0..1000).map(wave(1.3)).collect();
        let found = clips(&Axis::of(&clipped), 1000.0);
        assert!(found.len() >= 10, "{found:?}");
        for clip in &found {
            let run = &clipped[(clip.start_s * 1000.0).round() as usize..][..(clip.seconds * 1000.0).round() as usize];
            assert!(run.len() >= 3, "{clip:?}");
            assert!(run.iter().all(|x| x.abs() >= 1.0), "{clip:?}");
        }
        let two: Vec<f64> = (0..1000).map(|n| f64::from(n / 5 % 2)).collect();
        assert_eq!(clips(&Axis::of(&two), 1000.0), []);
        assert_eq!(clips(&Axis::of(&[2.0; 100]), 1000.0), []);
        assert_eq!(clips(&Axis::of(&[]), 1000.0), []);
    }
}
