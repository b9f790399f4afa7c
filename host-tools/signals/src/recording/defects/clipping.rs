//! Detection of clipping from the samples of a recording.

use std::ops::Range;

use super::axis::Axis;

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
    let runs = axis.at_limits.iter().filter(|&&at| {
        let run = samples.get(at..at + LEAST_RUN);
        run.is_some_and(flat)
    });
    if runs.count() < MIN_CLIPPED_SAMPLES {
        return 0.0;
    }
    outside as f64 / samples.len() as f64
}

/// Largest ratio of half a range to the RMS about the mean, within which [`rounded_share`] looks: a sine's is 1.4, that
/// of Gaussian noise 4.
const MOST_CREST: f64 = 2.2;

/// Least number of tops on either side that show a limit, and least height of nine tenths of the longer ones, as a
/// fraction of the highest: 0.63 at most in recordings without a limit, 0.71 or more where it takes 1.7 dB.
const LEAST_TOPS: usize = 40;
const EQUAL_TOPS: f64 = 0.71;

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
    if ![1.0, -1.0]
        .iter()
        .all(|sign| are_of_one_height(axis.samples.iter().map(|x| sign * height(x))))
    {
        return 0.0;
    }
    let at_tops = axis.samples.iter().filter(|x| height(x).abs() > EQUAL_TOPS).count();
    at_tops as f64 / axis.samples.len() as f64
}

/// Returns true if the longer tops of a signal, which is at most 1, are of one height, and their lengths differ.
fn are_of_one_height(signal: impl Iterator<Item = f64>) -> bool {
    let (mut tops, mut is_within): (Vec<(f64, f64)>, bool) = (Vec::new(), false);
    for x in signal {
        if x > 0.5 {
            if !is_within {
                tops.push((0.0, 0.0));
            }
            if let Some((length, height)) = tops.last_mut() {
                *length += 1.0;
                *height = x.max(*height);
            }
        }
        is_within = x > 0.5;
    }
    let at = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values[(share * values.len() as f64) as usize]
    };
    if tops.len() < LEAST_TOPS {
        return false;
    }
    let length = at(tops.iter().map(|top| top.0).collect(), 0.5);
    let heights = tops.iter().filter(|top| top.0 >= length).map(|top| top.1);
    let ratios = tops
        .windows(2)
        .map(|pair| (pair[0].0 / pair[1].0).max(pair[1].0 / pair[0].0));
    at(heights.collect(), 0.1) >= EQUAL_TOPS && at(ratios.collect(), 0.5) >= UNLIKE_LENGTHS
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
    let starts = axis.at_limits.iter().copied();
    let starts = starts.filter(|&at| at == 0 || !equal(at - 1));
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
    use std::f64::consts::TAU;
    use test_helpers::noise;

    /// Noise through a resonator at 0.03 of the rate, with an RMS of 1.
    fn texture(seed: u64) -> Vec<f64> {
        let (mut y, mut before) = (0.0, 0.0);
        let ring = noise(seed, 20_000).into_iter().map(|x| {
            (y, before) = (x + 1.8 * 0.982 * y - 0.81 * before, y);
            y
        });
        let ring: Vec<f64> = ring.collect();
        let rms = (ring.iter().map(|x| x * x).sum::<f64>() / ring.len() as f64).sqrt();
        ring.iter().map(|x| x / rms).collect()
    }

    /// The mean of four samples: a low-pass filter.
    fn filtered(samples: &[f64]) -> Vec<f64> {
        samples.windows(4).map(|four| four.iter().sum::<f64>() / 4.0).collect()
    }

    #[test]
    fn tops_that_a_filter_rounded_are_found_and_those_of_textures_tones_and_sweeps_are_not() {
        let share = |samples: &[f64]| rounded_share(&[Axis::of(samples)]);
        for seed in 0..20 {
            let texture = texture(seed);
            let clipped: Vec<f64> = texture.iter().map(|x| 9.81 + x.clamp(-1.0, 1.0)).collect();
            assert!(share(&filtered(&clipped)) > 0.2, "{seed}");
            assert_eq!(clipped_share(&[Axis::of(&filtered(&texture))]), 0.0);
            assert_eq!(share(&filtered(&texture)), 0.0, "{seed}");
            for depth in [0.02, 0.1, 0.3] {
                let tone = |sweep: f64| {
                    let phase = |n: f64| TAU * (0.004 * n + sweep * n * n);
                    (texture.iter().enumerate())
                        .map(|(n, x)| phase(n as f64).sin() + depth * x)
                        .collect::<Vec<_>>()
                };
                assert_eq!(share(&tone(0.0)), 0.0, "{seed}, {depth}");
                assert_eq!(share(&tone(2e-6)), 0.0, "{seed}, {depth}");
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
