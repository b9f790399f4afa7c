//! Powers of a number, at compile time, for the tables of codes.

/// eˣ for |x| below 0.1, by the series, whose rest is below 10⁻¹⁸.
pub(super) const fn exp(x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (1.0, 1.0, 1.0);
    while n < 13.0 {
        term *= x / n;
        sum += term;
        n += 1.0;
    }
    sum
}
