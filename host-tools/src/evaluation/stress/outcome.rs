//! The outcome of a hard case, and what of it breaks a promise.

use serde::Serialize;

use super::limits::{
    LEVEL_DB, MEAN_STANDARD_ERRORS, SNR_DB, SPECTRUM_DB, snr_limit_db, spectrum_limit_db,
};

/// The outcome of a case.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Outcome {
    /// Models and motion.
    pub case: String,
    /// Largest pole radius of the models.
    pub pole_radius: f64,
    /// Number of driven samples.
    pub samples: usize,
    /// Samples in which any signal of the state was at full scale while driven.
    pub saturated: usize,
    /// Level over the model's, dB, where it is known.
    pub level_db: Option<f64>,
    /// Signal to noise of the arithmetic, dB, where there is a float64 filter to compare with.
    pub snr_db: Option<f64>,
    /// The mean's distance from zero in standard errors.
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

/// The time after the drive.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Rest {
    /// Samples until nothing was left in the state; `None` if there was something to the end.
    pub silent_after: Option<usize>,
    /// Longest wait for silence, samples.
    pub limit: usize,
    /// Samples at which the state's norm grew, without any input.
    pub growing: usize,
    /// Largest norm over that at the begin, dB.
    pub growth_db: f64,
    /// Largest magnitude in the last thousand samples, as a share of full scale.
    pub left: f64,
}

impl Outcome {
    /// Returns the promises of a lattice that this breaks, each in a few words.
    pub fn broken(&self) -> Vec<String> {
        let mut broken = Vec::new();
        let mut unless = |holds: bool, what: String| {
            if !holds {
                broken.push(what);
            }
        };
        unless(self.saturated == 0, format!("{} saturated", self.saturated));
        let level = self.level_db.unwrap_or(0.0);
        unless(level.abs() <= LEVEL_DB, format!("level {level:+.2} dB"));
        let snr = self.snr_db.unwrap_or(f64::INFINITY);
        unless(
            snr >= snr_limit_db(self.pole_radius),
            format!("SNR {snr:.0} dB"),
        );
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

    /// Returns whether SNR and spectrum are within the limits of all but narrow lines.
    pub fn is_within_common_limits(&self) -> bool {
        self.snr_db.is_none_or(|snr| snr >= SNR_DB) && self.spectrum_db <= SPECTRUM_DB
    }

    /// Returns whether SNR and spectrum have the weaker limits of narrow lines.
    pub fn is_narrow(&self) -> bool {
        snr_limit_db(self.pole_radius) < SNR_DB || spectrum_limit_db(self.pole_radius) > SPECTRUM_DB
    }
}
