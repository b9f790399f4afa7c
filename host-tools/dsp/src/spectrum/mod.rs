//! Spectra of accelerations and the distances between them: the paper's cost (equation 6), power and error in
//! third-octave bands, and the log-spectral distance. "The paper" is Romano, Yoshioka and Kuchenbecker, ICRA 2010.
//!
//! Signals are real, evenly sampled at `rate_hz` and finite. The spectrum of a random signal (bands, log-spectral
//! distance) is Welch's estimate. The paper's cost is defined by the DFT of one whole recording.

mod bands;
mod cost;
mod power;
mod subtraction;

pub use bands::{
    AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ, THIRD_OCTAVE_RATIO, band_centre_hz, band_edges_hz, band_errors_db,
    band_errors_within_db, band_powers, distance_of_spectra_db, third_octave_hz,
};
pub use cost::{
    DEFAULT_SMOOTHING_WIDTH_HZ, cost_of_blocks, dft_amplitude, expected_cost_of_blocks, smoothed_amplitude,
    spectral_cost,
};
pub use power::{PowerSpectrum, longest_segment};
pub use subtraction::without_noise;

/// Signals that several tests of this folder use.
#[cfg(test)]
mod test_signals {
    use std::f64::consts::TAU;

    pub const RATE_HZ: f64 = 5000.0;

    pub fn scaled(signal: &[f64], factor: f64) -> Vec<f64> {
        signal.iter().map(|value| factor * value).collect()
    }

    pub fn sine(len: usize, frequency_hz: f64, amplitude: f64) -> Vec<f64> {
        let sample = |n: usize| amplitude * (TAU * frequency_hz * n as f64 / RATE_HZ).sin();
        (0..len).map(sample).collect()
    }

    pub fn close(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance * a.abs().max(b.abs())
    }
}
