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
