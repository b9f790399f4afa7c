//! Sums over samples and values that all measures share.

/// The blocks less their common mean; `None` if nothing but round-off is left of them, or a sample is not finite.
pub(super) fn centred(blocks: &[&[f64]]) -> Option<Vec<Vec<f64>>> {
    /// Power of round-off, as a share of the squared peak.
    const ROUND_OFF: f64 = 1e-24;
    let count: usize = blocks.iter().map(|block| block.len()).sum();
    let mean = blocks.iter().copied().flatten().sum::<f64>() / count.max(1) as f64;
    let peak = blocks
        .iter()
        .copied()
        .flatten()
        .fold(0.0f64, |peak, x| peak.max(x.abs()));
    let centred: Vec<Vec<f64>> = blocks
        .iter()
        .map(|block| block.iter().map(|x| x - mean).collect())
        .collect();
    let square = mean_square(centred.iter().flatten(), count);
    (square.is_finite() && square > ROUND_OFF * peak * peak && square > f64::MIN_POSITIVE)
        .then_some(centred)
}

/// Mean of the squares of `count` samples.
pub(super) fn mean_square<'a>(samples: impl Iterator<Item = &'a f64>, count: usize) -> f64 {
    samples.map(|x| x * x).sum::<f64>() / count.max(1) as f64
}

/// The median; `None` of nothing.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    let upper = values.get(half).copied()?;
    Some(if values.len() % 2 == 1 {
        upper
    } else {
        f64::midpoint(values[half - 1], upper)
    })
}
