//! Spectra of accelerations and the distances between them: the paper's cost (equation 6), power and error in
//! third-octave bands, and the log-spectral distance. "The paper" is Romano, Yoshioka and Kuchenbecker, ICRA 2010.
//!
//! Signals are real, evenly sampled at `rate_hz` and finite. The spectrum of a random signal (bands, log-spectral
//! distance) is Welch's estimate. The paper's cost is defined by the DFT of one whole recording.

mod amplitude;
mod bands;
mod cost;
mod log_spectral_distance;
mod power;
#[cfg(test)]
mod test_signals;

pub use amplitude::{dft_amplitude, smoothed_amplitude};
pub use bands::{
    AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ, band_centre_hz, band_edges_hz, band_errors_db,
    band_errors_within_db, band_powers,
};
pub use cost::{
    DEFAULT_SMOOTHING_WIDTH_HZ, cost_of_blocks, expected_cost_of_blocks, expected_cost_of_noise,
    spectral_cost,
};
pub use log_spectral_distance::{distance_of_spectra_db, log_spectral_distance_db};
pub use power::{PowerSpectrum, longest_segment};
