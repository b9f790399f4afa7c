//! Steps of a converter, from the smallest change between successive samples.

use super::axis::Axis;

/// Returns the ratio of the power of `axis` about its mean to that of the round-off of its steps, a twelfth of their
/// square, in dB; infinite for a constant.
pub(super) fn snr_db(axis: &Axis<'_>) -> f64 {
    let step = axis.least_step;
    if step.is_finite() {
        20.0 * (axis.deviation * 12f64.sqrt() / step).log10()
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_a_tenth_of_the_level_are_thirty_decibels_below_it() {
        let wave =
            (0..5000).map(|n| (2f64.sqrt() * (0.1237 * f64::from(n)).sin() * 10.0).round() / 10.0);
        let snr = snr_db(&Axis::of(&wave.collect::<Vec<_>>()));
        assert!((snr - 30.8).abs() < 0.3, "{snr}");
        assert_eq!(snr_db(&Axis::of(&[2.0; 100])), f64::INFINITY);
    }
}
