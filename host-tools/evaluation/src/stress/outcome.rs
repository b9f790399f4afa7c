//! The outcome of a hard case, and which promises it breaks.

use model_format::THETA_STEP_RAD;
use serde::Serialize;

/// The outcome of a case.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Outcome {
    /// Models and motion.
    pub case: String,
    /// Largest pole radius of the models.
    pub pole_radius: f64,
    /// Number of driven samples.
    pub samples: usize,
    /// Number of samples in which any signal of the state was at full scale, or the output saturated, while driven.
    pub saturated: usize,
    /// Level relative to the model's, dB, if it is known.
    pub level_db: Option<f64>,
    /// Signal-to-noise ratio of the arithmetic, dB, if there is a float64 filter to compare with.
    pub snr_db: Option<f64>,
    /// Distance of the output's mean from zero, in standard errors.
    pub mean_standard_errors: f64,
    /// Largest difference of the stored from the fitted spectrum, dB.
    pub spectrum_db: f64,
    /// After the drive stopped.
    pub stopped: Rest,
    /// After an overdrive stopped.
    pub overdriven: Rest,
    /// After full scale in every signal of the state.
    pub glitched: Rest,
}

/// Behaviour after the drive.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Rest {
    /// Number of samples until the state was zero; `None` if it was never zero.
    pub silent_after: Option<usize>,
    /// Longest wait for silence, samples.
    pub limit: usize,
    /// Number of samples at which the state's norm grew, without any input.
    pub growing: usize,
    /// Largest norm of the state, relative to that at the beginning, dB.
    pub growth_db: f64,
    /// Largest magnitude in the last thousand samples, as a fraction of full scale.
    pub left: f64,
}

impl Outcome {
    /// Returns the promises of a lattice that this outcome breaks, each in a few words.
    pub fn broken(&self) -> Vec<String> {
        let mut broken = Vec::new();
        let mut unless = |holds: bool, what: String| {
            if !holds {
                broken.push(what);
            }
        };
        unless(self.saturated == 0, format!("{} saturated", self.saturated));
        // What is not known breaks no promise.
        let level = self.level_db.unwrap_or(0.0);
        unless(level.abs() <= LEVEL_DB, format!("level {level:+.2} dB"));
        let snr = self.snr_db.unwrap_or(f64::INFINITY);
        unless(snr >= snr_limit_db(self.pole_radius), format!("SNR {snr:.0} dB"));
        let mean = self.mean_standard_errors;
        unless(mean <= MEAN_STANDARD_ERRORS, format!("mean {mean:.1} SE"));
        let spectrum = self.spectrum_db;
        unless(
            spectrum <= spectrum_limit_db(self.pole_radius),
            format!("spectrum {spectrum:.2} dB"),
        );
        for (rest, after) in [
            (self.stopped, "stop"),
            (self.overdriven, "overdrive"),
            (self.glitched, "glitch"),
        ] {
            unless(
                rest.growing == 0,
                format!("grows {:.1} dB after {after}", rest.growth_db),
            );
            unless(
                rest.silent_after.is_some(),
                match rest.left {
                    left if left > 0.01 => format!("latched at {left:.2} FS after {after}"),
                    left => format!("{left:.0e} FS left after {after}"),
                },
            );
        }
        broken
    }

    /// Returns whether SNR and spectrum are within the common limits, which hold for all models except those with
    /// narrow lines.
    pub fn is_within_common_limits(&self) -> bool {
        self.snr_db.is_none_or(|snr| snr >= SNR_DB) && self.spectrum_db <= SPECTRUM_DB
    }

    /// Returns whether SNR and spectrum have the weaker limits of narrow lines.
    pub fn is_narrow(&self) -> bool {
        snr_limit_db(self.pole_radius) < SNR_DB || spectrum_limit_db(self.pole_radius) > SPECTRUM_DB
    }
}

/// Largest difference of a lattice's level from the node's power, dB.
pub const LEVEL_DB: f64 = 0.2;
/// Least signal-to-noise ratio of a lattice's arithmetic, dB; see `snr_limit_db`.
pub const SNR_DB: f64 = 108.0;
/// Largest mean of a lattice's output, in standard errors.
pub const MEAN_STANDARD_ERRORS: f64 = 4.0;
/// Largest difference between fitted and stored spectrum of a lattice, dB; see `spectrum_limit_db`.
pub const SPECTRUM_DB: f64 = 0.05;

/// Largest pole radius up to which [`SNR_DB`] is promised.
const SNR_RADIUS: f64 = 0.999;

/// Returns the SNR that is promised for models with this pole radius, dB.
///
/// Truncation removes at most one step per stage and sample from a signal, always toward zero, so it damps. In a line
/// that rings for 1/(1 - r) samples, these errors add up in phase. Beyond radius 0.999, each reduction of 1 - r to a
/// tenth therefore costs 20 dB. Another 3 dB are for lines that have not rung up yet. The level hardly changes: at
/// radius 0.99999 it is off by two thousandths of a dB.
pub fn snr_limit_db(pole_radius: f64) -> f64 {
    let beyond = (1.0 - SNR_RADIUS) / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    // The margin keeps 0.999 itself, with its rounding error, at the common limit.
    if beyond < 1.0 + 1e-9 {
        SNR_DB
    } else {
        SNR_DB - 3.0 - 20.0 * beyond.log10()
    }
}

/// Returns the difference of spectra that is promised for models with this pole radius, dB.
///
/// Half a step of θ moves a line by 2.4e-5 rad, 0.02 Hz at 5 kHz. A line of half width 1 - r that is moved by s half
/// widths differs from itself by up to 20 log₁₀((s + √(s² + 4)) / 2), on its flank: 0.05 dB at radius 0.998, 8.8 dB at
/// 0.99999, a line 0.016 Hz wide.
pub fn spectrum_limit_db(pole_radius: f64) -> f64 {
    let shift = THETA_STEP_RAD / 2.0 / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    let flank = 20.0 * (shift.midpoint((shift * shift + 4.0).sqrt())).log10();
    flank.max(SPECTRUM_DB)
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    #[test]
    fn narrow_lines_have_limits_of_their_own_and_others_the_common_ones() {
        assert_eq!(snr_limit_db(0.99), SNR_DB);
        assert_eq!(spectrum_limit_db(0.99), SPECTRUM_DB);
        near(snr_limit_db(0.9999), 85.0, 1e-6);
        near(snr_limit_db(0.999_99), 65.0, 1e-6);
        assert!((8.0..9.0).contains(&spectrum_limit_db(0.999_99)));
    }
}
