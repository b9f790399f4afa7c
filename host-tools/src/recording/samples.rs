//! The samples of a trial, in m/s² at the models' rate.

/// The samples of a trial.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One to three axes of one length, at [`SAMPLE_RATE_HZ`], m/s².
    pub axes: Vec<Vec<f64>>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Share of the file's own samples that are cut off at the ends of their range, of the worst axis.
    pub clipped_share: f64,
}
