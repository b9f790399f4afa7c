//! Moments of a signal about zero.

/// Mean x⁴ / (mean x²)²; `None` for silence and for what is not finite.
pub(super) fn kurtosis<'a>(signal: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (mut count, mut square, mut fourth) = (0.0, 0.0, 0.0);
    for x in signal {
        let power = x * x;
        count += 1.0;
        square += power;
        fourth += power * power;
    }
    Some(fourth * count / (square * square)).filter(|kurtosis| kurtosis.is_finite())
}

/// Greatest magnitude over the RMS; `None` for silence and for what is not finite.
pub(super) fn crest_factor<'a>(signal: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (mut count, mut square, mut peak) = (0.0, 0.0, 0.0f64);
    for x in signal {
        count += 1.0;
        square += x * x;
        peak = peak.max(x.abs());
    }
    Some(peak / f64::sqrt(square / count)).filter(|crest| crest.is_finite())
}
