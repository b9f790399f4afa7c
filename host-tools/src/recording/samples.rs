//! The samples of a trial, in m/s² at the models' sample rate.

/// The samples of a trial.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One to three axes of equal length, at [`SAMPLE_RATE_HZ`](model_format::SAMPLE_RATE_HZ), m/s².
    pub axes: Vec<Vec<f64>>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Share of clipped samples on the worst axis, of the samples at the file's own rate.
    pub clipped_share: f64,
}
