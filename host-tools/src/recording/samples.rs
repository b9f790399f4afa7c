//! The samples of a trial, in m/s² at the models' sample rate.

use super::defects::Defects;

/// The samples of a trial.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One to three axes of equal length, m/s²: at [`SAMPLE_RATE_HZ`](model_format::SAMPLE_RATE_HZ), unless another
    /// rate was asked for.
    pub axes: Vec<Vec<f64>>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Findings on the samples at the file's own rate.
    pub defects: Defects,
}
