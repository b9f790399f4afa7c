//! Identification of an actuator: a waveform that excites it, its response with a confidence for each line, and the
//! resonance that explains the response.
//!
//! All waveforms are periodic at 5 kHz with [`PERIOD`] samples. So each line of the spectrum is exactly one bin, there
//! is no leakage, and any difference between two periods is noise. Lines that the waveform leaves out show the
//! distortion that the actuator adds: even lines show what is not symmetric, odd lines what is symmetric (Pintelon and
//! Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed., 2012, chapters 2 and 4).

mod measured;
mod multisine;
mod resonance;

pub use measured::{Band, Bandwidths, Line, MeasuredResponse, Spectra};
pub use multisine::Multisine;
pub use resonance::{Fit, Resonance};

use crate::spectrum::third_octave_hz;

/// Sample rate of waveforms and recordings, Hz.
pub const RATE_HZ: f64 = 5000.0;

/// Samples per period: 0.4 s.
pub const PERIOD: usize = 2000;

/// Spacing of neighbouring lines, Hz.
pub const STEP_HZ: f64 = RATE_HZ / PERIOD as f64;

/// Number of third-octave bands from 10 Hz to 1 kHz.
pub const BANDS: usize = 21;

/// Position of the band at 10 Hz on the scale of [`third_octave_hz`].
const LOWEST_BAND: f64 = -3.0;

/// Returns the centre frequency of a third-octave band, Hz: 10 · 10^(band/10), as in IEC 61260-1.
pub fn band_centre_hz(band: usize) -> f64 {
    third_octave_hz(LOWEST_BAND + band as f64)
}

/// Returns the lower and upper edge of a third-octave band, Hz.
pub fn band_edges_hz(band: usize) -> [f64; 2] {
    [-0.5, 0.5].map(|half| third_octave_hz(LOWEST_BAND + band as f64 + half))
}

/// Converts a ratio of amplitudes to dB.
pub fn db(ratio: f64) -> f64 {
    20.0 * ratio.log10()
}

/// Converts dB to a ratio of amplitudes.
pub fn ratio(db: f64) -> f64 {
    10f64.powf(db / 20.0)
}
