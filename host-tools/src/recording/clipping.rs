//! Clipping, as the samples of a recording show it.

/// Fewest clipped samples that count, so that a short recording is not judged by one.
const CLIPPED_SAMPLES: usize = 8;

/// Share of the samples of the worst axis that are cut off at its ends. To be asked of samples as they were recorded:
/// resampling rounds the flat tops away.
pub fn clipped_share(axes: &[Vec<f64>]) -> f64 {
    axes.iter()
        .map(|axis| clipped_share_of(axis))
        .fold(0.0, f64::max)
}

/// Share of samples that stand at the highest or lowest value, if they do so in runs of three or more.
///
/// A signal that moves freely meets its extreme once, or twice about the top of a slow wave. One that is constant, or
/// has two values only, is not what clipping looks like.
fn clipped_share_of(axis: &[f64]) -> f64 {
    let (low, high) = extremes(axis);
    if low >= high {
        return 0.0;
    }
    // A gain or an offset in floating point leaves a clipped top not quite flat.
    let tolerance = 1e-6 * (high - low);
    let (low, high) = (low + tolerance, high - tolerance);
    let at_extreme = |x: &f64| *x >= high || *x <= low;
    let outside = axis.iter().filter(|x| at_extreme(x)).count();
    if outside < CLIPPED_SAMPLES || outside == axis.len() {
        return 0.0;
    }
    let flat = |run: &&[f64]| run.iter().all(|x| (x - run[0]).abs() <= tolerance);
    let in_runs = axis
        .windows(3)
        .filter(|run| at_extreme(&run[0]) && flat(run))
        .count();
    if in_runs < CLIPPED_SAMPLES {
        return 0.0;
    }
    outside as f64 / axis.len() as f64
}

/// Lanes that a compiler keeps in vector registers.
const LANES: usize = 8;

/// Lowest and highest of finite values.
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
