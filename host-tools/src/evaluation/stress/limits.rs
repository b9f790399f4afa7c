//! Promises of the lattice, and how they weaken with narrow lines.

use model_format::THETA_STEP_RAD;

/// Largest difference of a lattice's level from the node's power, dB.
pub const LEVEL_DB: f64 = 0.2;
/// Least signal-to-noise ratio of a lattice's arithmetic, dB; see [`snr_limit_db`].
pub const SNR_DB: f64 = 108.0;
/// Largest mean of a lattice's output, in standard errors.
pub const MEAN_STANDARD_ERRORS: f64 = 4.0;
/// Largest difference between fitted and stored spectrum of a lattice, dB; see [`spectrum_limit_db`].
pub const SPECTRUM_DB: f64 = 0.05;

/// Largest pole radius up to which [`SNR_DB`] is promised.
const SNR_RADIUS: f64 = 0.999;

/// The SNR that is promised of models of this pole radius, dB.
///
/// Truncation takes at most one step per stage and sample from a signal, always toward zero, so it damps. A line that rings
/// for 1/(1 - r) samples adds that up in phase. Each tenth of 1 - r beyond 0.999 therefore costs 20 dB; 3 dB more are for
/// lines that have not rung up yet. The level stays: at radius 0.99999 it is off by two thousandths of a dB.
pub fn snr_limit_db(pole_radius: f64) -> f64 {
    let beyond = (1.0 - SNR_RADIUS) / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    // Not for 0.999 itself and the rounding of it.
    if beyond < 1.0 + 1e-9 {
        SNR_DB
    } else {
        SNR_DB - 3.0 - 20.0 * beyond.log10()
    }
}

/// The difference of spectra that is promised of models of this pole radius, dB.
///
/// Half a step of θ moves a line by 2.4e-5 rad, 0.02 Hz at 5 kHz. A line of half width 1 - r that is moved by s half widths
/// differs from itself by up to 20 log₁₀((s + √(s² + 4)) / 2), on its flank: 0.05 dB at radius 0.998, 8.8 dB at 0.99999, a line
/// 0.016 Hz wide.
pub fn spectrum_limit_db(pole_radius: f64) -> f64 {
    let shift = THETA_STEP_RAD / 2.0 / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    let flank = 20.0 * (shift.midpoint((shift * shift + 4.0).sqrt())).log10();
    flank.max(SPECTRUM_DB)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_lines_have_limits_of_their_own_and_others_the_common_ones() {
        assert_eq!(
            (snr_limit_db(0.99), spectrum_limit_db(0.99)),
            (SNR_DB, SPECTRUM_DB)
        );
        assert!((snr_limit_db(0.9999) - 85.0).abs() < 1e-6);
        assert!((snr_limit_db(0.999_99) - 65.0).abs() < 1e-6);
        assert!((8.0..9.0).contains(&spectrum_limit_db(0.999_99)));
    }
}
