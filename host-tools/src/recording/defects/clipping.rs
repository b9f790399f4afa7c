//! Detection of clipping from the samples of a recording.

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

/// Number of partial results, which the compiler keeps in vector registers.
const LANES: usize = 8;

/// Returns the lowest and the highest of finite values.
fn extremes(axis: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = ([f64::MAX; LANES], [f64::MIN; LANES]);
    let (chunks, rest) = axis.as_chunks::<LANES>();
    for chunk in chunks {
        for ((low, high), &x) in low.iter_mut().zip(&mut high).zip(chunk) {
            *low = if x < *low { x } else { *low };
            *high = if x > *high { x } else { *high };
        }
    }
    let least = low.iter().chain(rest).fold(f64::MAX, |a, &b| a.min(b));
    let most = high.iter().chain(rest).fold(f64::MIN, |a, &b| a.max(b));
    (least, most)
}
