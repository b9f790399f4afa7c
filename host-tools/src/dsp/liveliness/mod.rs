//! Measures of properties that a power spectrum does not show: impulses, a level that changes, and a line that
//! fluctuates.
//!
//! | measure | definition | Gaussian noise, white |
//! |---|---|---|
//! | kurtosis | mean x⁴ / (mean x²)² about the mean | 3 |
//! | residual kurtosis | median over windows of 50 ms of the kurtosis of the prediction error | 2.94 |
//! | crest factor | greatest magnitude over the RMS | 4.2 in 10 s |
//! | modulation | RMS of the part from 8 to 64 Hz of the envelope of 100 to 1000 Hz, over the envelope's mean | 0.18 |
//! | level spread, dB | standard deviation of the levels of windows of 50 ms | 0.39 |
//! | line's range, dB | highest less lowest level of the strongest narrow line in windows of 0.5 s | no line |
//!
//! The envelope is the magnitude of the analytic signal of the band's bins of a Fourier transform, block by block; its
//! power from 8 to 64 Hz is Welch's estimate with Hann windows of up to 0.82 s. The predictor is the signal's own, of
//! up to order 100, by Levinson and Durbin from lags within blocks. All means are of the signal less its mean over all
//! blocks. Kurtosis, crest factor and ranges grow with a signal's duration, so that only signals of one duration
//! compare.

mod level;
mod line;
mod moments;
mod residual;
#[cfg(test)]
mod tests;
mod values;

pub use level::{LEVEL_WINDOW_S, MODULATION_BAND_HZ, MODULATION_HZ};
pub use line::strongest_line_hz;
pub use values::median;

use values::centred;

use serde::{Deserialize, Serialize};

/// The measures of one signal; none where they do not exist, as of silence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Liveliness {
    /// Kurtosis of the signal; 3 for Gaussian noise.
    pub kurtosis: Option<f64>,
    /// Median kurtosis of the prediction error within windows of 50 ms.
    pub residual_kurtosis: Option<f64>,
    /// Greatest magnitude over the RMS.
    pub crest_factor: Option<f64>,
    /// The envelope's 8 to 64 Hz over its mean.
    pub modulation: Option<f64>,
    /// Standard deviation of the levels of windows of 50 ms, dB.
    pub level_spread_db: Option<f64>,
    /// Highest less lowest level of the line in windows of 0.5 s, dB.
    pub line_range_db: Option<f64>,
}

impl Liveliness {
    /// Measures a signal in blocks, sampled at `rate_hz`, and its line near `line_hz`, if there is one.
    ///
    /// Blocks that are shorter than a window have no part in what windows measure.
    pub fn of(blocks: &[&[f64]], rate_hz: f64, line_hz: Option<f64>) -> Self {
        let Some(centred) = centred(blocks) else {
            return Self::default();
        };
        let blocks: Vec<&[f64]> = centred.iter().map(Vec::as_slice).collect();
        Self {
            kurtosis: moments::kurtosis(blocks.iter().copied().flatten()),
            residual_kurtosis: residual::kurtosis(&blocks, rate_hz),
            crest_factor: moments::crest_factor(blocks.iter().copied().flatten()),
            modulation: level::modulation(&blocks, rate_hz),
            level_spread_db: level::spread_db(&blocks, rate_hz),
            line_range_db: line_hz.and_then(|near| line::range_db(&blocks, rate_hz, near)),
        }
    }

    /// The median of each measure over several signals, of those that have it.
    pub fn median(of: &[Self]) -> Self {
        let median = |measure: fn(&Self) -> Option<f64>| median(of.iter().filter_map(measure));
        Self {
            kurtosis: median(|l| l.kurtosis),
            residual_kurtosis: median(|l| l.residual_kurtosis),
            crest_factor: median(|l| l.crest_factor),
            modulation: median(|l| l.modulation),
            level_spread_db: median(|l| l.level_spread_db),
            line_range_db: median(|l| l.line_range_db),
        }
    }
}
