//! Standard deviation of an axis.

use crate::dsp::sums::variance;

/// RMS about the mean.
pub(super) fn deviation(axis: &[f64]) -> f64 {
    variance(axis).sqrt()
}
