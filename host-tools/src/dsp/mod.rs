//! Signal processing: spectra, linear prediction, and the reduction of three axes to one.
//!
//! Invariant: slices in, numbers out. No files, no command line, no progress, no format of a library.

pub mod analytic;
pub mod autocorrelation;
pub mod binomial;
pub mod line_spectral_frequencies;
pub mod linear_prediction;
pub mod liveliness;
pub mod log_spectrum;
pub mod model;
pub mod model_error;
pub mod phase_correlation;
pub mod reduction;
pub mod spectrum;
pub mod sums;
mod transform;
mod vectors;

pub(crate) use transform::with_planner;
pub(crate) use vectors::wide;
