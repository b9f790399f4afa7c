//! Detection of clipping from the samples of a recording.

use crate::dsp::sums::extremes;

/// Smallest number of clipped samples that counts, because one sample is no evidence in a short recording.
const MIN_CLIPPED_SAMPLES: usize = 8;

/// Returns the share of clipped samples on the worst axis.
///
/// `axes` must have the recording's own sample rate, because resampling rounds flat tops.
pub fn clipped_share(axes: &[Vec<f64>]) -> f64 {
    axes.iter()
        .map(|axis| clipped_share_of(axis))
        .fold(0.0, f64::max)
}

/// Returns the share of samples at the highest or lowest value, if they are in runs of three or more.
///
/// An unclipped signal reaches its extreme once, or twice at the top of a slow wave. A signal of only one or two values
/// does not count as clipped.
fn clipped_share_of(axis: &[f64]) -> f64 {
    let (low, high) = extremes(axis);
    if low >= high {
        return 0.0;
    }
    // Round-off of a gain or an offset leaves a clipped top not exactly flat.
    let tolerance = 1e-6 * (high - low);
    let (low, high) = (low + tolerance, high - tolerance);
    let at_extreme = |x: &f64| *x >= high || *x <= low;
    let outside = axis.iter().filter(|x| at_extreme(x)).count();
    if outside < MIN_CLIPPED_SAMPLES || outside == axis.len() {
        return 0.0;
    }
    let flat = |run: &&[f64]| run.iter().all(|x| (x - run[0]).abs() <= tolerance);
    let in_runs = axis
        .windows(3)
        .filter(|run| at_extreme(&run[0]) && flat(run))
        .count();
    if in_runs < MIN_CLIPPED_SAMPLES {
        return 0.0;
    }
    outside as f64 / axis.len() as f64
}

/// A stretch of samples that are clipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub seconds: f64,
}

/// Returns the runs of three or more equal samples at the highest or lowest value of `axis`, in the order of time; none
/// if the signal has one or two values only. Few runs do not make a recording clipped, but none of them is a surface's.
pub(super) fn clips(axis: &[f64], rate_hz: f64) -> Vec<Clip> {
    const LEAST_RUN: usize = 3;
    let (low, high) = extremes(axis);
    let tolerance = 1e-6 * (high - low);
    let at_extreme = |x: f64| x >= high - tolerance || x <= low + tolerance;
    if low >= high || axis.iter().all(|&x| at_extreme(x)) {
        return Vec::new();
    }
    let runs = axis.chunk_by(|a, b| (a - b).abs() <= tolerance);
    let mut first = 0;
    let starts = runs.map(|run| {
        let start = first;
        first += run.len();
        (start, run)
    });
    let clipped = starts.filter(|(_, run)| run.len() >= LEAST_RUN && at_extreme(run[0]));
    let clip = |(start, run): (usize, &[f64])| Clip {
        start_s: start as f64 / rate_hz,
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
            move |n: u32| {
                (gain * (0.05 * f64::from(n)).sin() + 0.1 * f64::from(n * n % 97) / 97.0)
                    .clamp(-1.0, 1.0)
            }
        };
        let clean: Vec<f64> = (0..1000).map(wave(0.8)).collect();
        assert_eq!(clips(&clean, 1000.0), []);
        let clipped: Vec<f64> = (0..1000).map(wave(1.3)).collect();
        let found = clips(&clipped, 1000.0);
        assert!(found.len() >= 10, "{found:?}");
        for clip in &found {
            let run = &clipped[(clip.start_s * 1000.0).round() as usize..]
                [..(clip.seconds * 1000.0).round() as usize];
            assert!(
                run.len() >= 3 && run.iter().all(|x| x.abs() >= 1.0),
                "{clip:?}"
            );
        }
        let two: Vec<f64> = (0..1000).map(|n| f64::from(n / 5 % 2)).collect();
        assert_eq!(clips(&two, 1000.0), []);
        assert_eq!(clips(&[2.0; 100], 1000.0), []);
        assert_eq!(clips(&[], 1000.0), []);
    }
}
