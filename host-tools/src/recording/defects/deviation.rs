//! Standard deviation of an axis.

/// RMS about the mean.
pub(super) fn deviation(axis: &[f64]) -> f64 {
    let Some(&first) = axis.first() else {
        return 0.0;
    };
    let n = axis.len() as f64;
    // About the first sample, so that a large offset costs no digits.
    let mean = axis.iter().map(|x| x - first).sum::<f64>() / n;
    let square = axis
        .iter()
        .map(|x| (x - first - mean) * (x - first - mean))
        .sum::<f64>();
    (square / n).sqrt()
}
