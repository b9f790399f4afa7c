//! Scores of differences that skin can feel: the level in third octaves, and the balance of low and high.
//!
//! The scores depend on two spectra only, not on models. No fit uses them. Only the frequencies of a [`ScoringRange`]
//! count.
//!
//! | score | definition |
//! |---|---|
//! | level error, JND | √(max(0, mean over third octaves b of (e_b² - s_b²))) / 2.2 dB |
//! | balance, dB | 10 log10 of the ratio of the power below 100 Hz to the power above |
//!
//! e_b is the level of the second signal relative to the first, dB. s_b² is the variance that e_b has between two
//! estimates of one Gaussian noise, (10/ln 10)² (ψ′(n₁) + ψ′(n₂)) for means of 2n₁ and 2n₂ squares, so that another
//! seed of the same noise scores 0 on average. A gain of -6 dB scores 2.7.
//!
//! Sources. JND of level 2.2 to 2.5 dB: Israr 2006. Energy per critical band predicts the realism of textures: arXiv
//! 2605.23804. Balance of low and high as the main cue: Bernard 2023.

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;
use stylus_dsp::high_pass::lowest_hz;
use stylus_dsp::spectrum::{
    AMPLITUDE_JND_DB, BAND_COUNT, PowerSpectrum, THIRD_OCTAVE_RATIO, band_edges_hz, band_errors_within_db,
    longest_segment,
};
use stylus_fit::fit::carried_hz;

/// The frequency that divides low from high, Hz: below it skin follows single cycles, above it feels a tone or noise.
pub const LOW_HIGH_HZ: f64 = 100.0;

/// The comparison of a signal with a reference, in terms of what is felt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Perceived {
    /// Level error in third octaves, in JND.
    pub level_error_jnd: Option<f64>,
    /// The square of the level error before a negative value becomes 0, JND². This value is averaged over trials.
    pub level_error_squared_jnd: Option<f64>,
    /// Balance of low and high minus the reference's balance, dB.
    pub balance_error_db: Option<f64>,
}

impl Perceived {
    /// Compares a signal's spectrum with that of its reference.
    pub fn of(reference: &PowerSpectrum, signal: &PowerSpectrum, range: &ScoringRange) -> Self {
        let squared = level_error_squared_jnd(reference, signal, range);
        let balances = balance_db(signal, range).zip(balance_db(reference, range));
        Self {
            level_error_jnd: squared.map(|square| square.max(0.0).sqrt()),
            level_error_squared_jnd: squared,
            balance_error_db: balances.map(|(signal, reference)| signal - reference),
        }
    }
}

/// Returns the mean square of the level error in third octaves, in JND², minus the mean square difference of two
/// estimates of one Gaussian noise. It is 0 on average for another take of the same noise, and may be negative.
///
/// `None` if the range holds no third octave, or a band has no power.
fn level_error_squared_jnd(reference: &PowerSpectrum, other: &PowerSpectrum, range: &ScoringRange) -> Option<f64> {
    let errors = band_errors_within_db(reference, other, range.band_edges_hz());
    let (mut sum, mut count) = (0.0, 0);
    for (band, error_db) in errors.iter().enumerate().take(BAND_COUNT) {
        let (low, high) = band_edges_hz(band);
        if !range.holds(low, high) {
            continue;
        }
        let error_db = (*error_db)?;
        let scatter = |spectrum: &PowerSpectrum| {
            (10.0 / std::f64::consts::LN_10).powi(2) * trigamma(spectrum.averages_between(low, high))
        };
        sum += error_db.powi(2) - scatter(reference) - scatter(other);
        count += 1;
    }
    // Without a band, this is not a number.
    let mean = sum / f64::from(count) / AMPLITUDE_JND_DB.powi(2);
    Some(mean).filter(|mean| mean.is_finite())
}

/// Trigamma function ψ′ above zero: recurrence up to 6, then the asymptotic series (Abramowitz and Stegun 6.4.12). The
/// logarithm of a mean of squares of 2x Gaussian numbers has this variance.
fn trigamma(mut x: f64) -> f64 {
    let mut sum = 0.0;
    // From 6 on, the first term that is left out, 1/(42 x⁷), is below 1e-7.
    while x < 6.0 {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    sum + 1.0 / x + 1.0 / (2.0 * x * x) + 1.0 / (6.0 * x.powi(3)) - 1.0 / (30.0 * x.powi(5))
}

/// Returns the ratio of the power below [`LOW_HIGH_HZ`] to the power above, within `range`, dB.
fn balance_db(spectrum: &PowerSpectrum, range: &ScoringRange) -> Option<f64> {
    // If the range lies on one side of the division, the other side has no power, and the balance is not finite.
    let low = spectrum.power_between(range.low_hz, LOW_HIGH_HZ.min(range.high_hz));
    let high = spectrum.power_between(LOW_HIGH_HZ.max(range.low_hz), range.high_hz);
    Some(10.0 * (low / high).log10()).filter(|balance| balance.is_finite())
}

/// Number of steps of the resolution that the narrowest window of a third octave must be wide.
const RESOLUTION_STEPS: f64 = 2.0;

/// The range over which the log-spectral distance is computed where the recording allows it, Hz.
pub const DISTANCE_RANGE_HZ: (f64, f64) = (30.0, 1000.0);

/// The frequencies at which a recording is judged: none above its own half sample rate, and none that its blocks do not
/// resolve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ScoringRange {
    /// Lowest frequency of bands, Hz.
    pub low_hz: f64,
    /// Highest frequency of bands, Hz.
    pub high_hz: f64,
    /// Lowest and highest frequency of the cost C, Hz.
    pub cost_hz: (f64, f64),
    /// Samples per segment of a power spectrum.
    #[serde(skip)]
    pub segment: usize,
}

impl ScoringRange {
    /// The range of a recording of `source_rate_hz` that is judged in blocks of `block` samples at 5 kHz. `None` if no
    /// third octave is left.
    ///
    /// A window of a third octave from f on is 0.26 f wide and must be two steps of the resolution wide, 2/T for
    /// segments of T = 1 s, or of a block if that is shorter.
    pub fn of(source_rate_hz: f64, block: usize) -> Option<Self> {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let segment = longest_segment(rate_hz).min(block);
        // A Hann window of one sample is zero.
        if segment < 2 {
            return None;
        }
        let resolved_hz = RESOLUTION_STEPS * rate_hz / segment as f64 / (THIRD_OCTAVE_RATIO - 1.0);
        let (lowest_hz, highest_hz) = (band_edges_hz(0).0, band_edges_hz(BAND_COUNT - 1).1);
        let own_hz = carried_hz(source_rate_hz).unwrap_or(rate_hz / 2.0);
        let range = Self {
            low_hz: lowest_hz.max(resolved_hz),
            high_hz: highest_hz.min(own_hz),
            // From the first bin of a block's transform on: the mean is no part of a texture.
            cost_hz: (rate_hz / block as f64, own_hz),
            segment,
        };
        Some(range).filter(Self::holds_a_third_octave)
    }

    /// Like [`ScoringRange::of`], for recordings that were high-pass filtered at `cut_hz`, if at all.
    pub fn of_filtered(source_rate_hz: f64, block: usize, cut_hz: Option<f64>) -> Option<Self> {
        let range = Self::of(source_rate_hz, block)?;
        match cut_hz {
            Some(cut_hz) => range.above(lowest_hz(cut_hz)),
            None => Some(range),
        }
    }

    /// Returns the range without the frequencies below `low_hz`. `None` if no third octave is left.
    fn above(mut self, low_hz: f64) -> Option<Self> {
        self.low_hz = self.low_hz.max(low_hz);
        self.cost_hz.0 = self.cost_hz.0.max(low_hz);
        Some(self).filter(Self::holds_a_third_octave)
    }

    /// The lowest and the highest frequency of bands, Hz.
    pub fn band_edges_hz(&self) -> (f64, f64) {
        (self.low_hz, self.high_hz)
    }

    /// The range of the log-spectral distance, Hz.
    pub fn distance_hz(&self) -> (f64, f64) {
        let (low_hz, high_hz) = DISTANCE_RANGE_HZ;
        (low_hz.max(self.low_hz), high_hz.min(self.high_hz))
    }

    /// Returns whether the band from `low_hz` to `high_hz` lies in the range, edges included.
    pub fn holds(&self, low_hz: f64, high_hz: f64) -> bool {
        low_hz >= self.low_hz * (1.0 - 1e-9) && high_hz <= self.high_hz * (1.0 + 1e-9)
    }

    fn holds_a_third_octave(&self) -> bool {
        self.bands() > 0
    }

    /// The number of third octaves that lie in the range.
    pub fn bands(&self) -> usize {
        (0..BAND_COUNT)
            .map(band_edges_hz)
            .filter(|(low, high)| self.holds(*low, *high))
            .count()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use test_helpers::{near, noise, resonant};

    const RATE_HZ: f64 = 5000.0;

    /// Noise through one resonance at `frequency_hz`.
    fn surface(len: usize, seed: u64, frequency_hz: f64) -> Vec<f64> {
        resonant(noise(seed, len + 1000), TAU * frequency_hz / RATE_HZ, 0.97).split_off(1000)
    }

    fn blocks(signal: &[f64]) -> Vec<&[f64]> {
        signal.chunks_exact(2500).collect()
    }

    fn spectrum(signal: &[f64], range: &ScoringRange) -> PowerSpectrum {
        PowerSpectrum::of_blocks(&blocks(signal), range.segment, RATE_HZ)
    }

    fn score(reference: &[f64], signal: &[f64]) -> Perceived {
        let range = ScoringRange::of(RATE_HZ, 2500).unwrap();
        let [reference, signal] = [reference, signal].map(|signal| spectrum(signal, &range));
        Perceived::of(&reference, &signal, &range)
    }

    #[test]
    fn trigamma_has_its_known_values() {
        let pi = std::f64::consts::PI;
        for (x, value) in [(1.0, pi * pi / 6.0), (0.5, pi * pi / 2.0), (10.0, 0.105_166_335_7)] {
            near(trigamma(x), value, 1e-6);
        }
    }

    /// Compares one second with ten, like a recording's judged blocks with a synthesis.
    #[test]
    fn another_seed_of_one_surface_scores_about_nothing() {
        let pairs = 30;
        let mut mean = 0.0;
        for seed in 0..pairs {
            let (a, b) = (surface(5000, 2 * seed, 90.0), surface(50_000, 2 * seed + 1, 90.0));
            mean += score(&a, &b).level_error_squared_jnd.unwrap() / pairs as f64;
        }
        // The variance of levels of few averages is approximate. A tenth of a squared JND is less than a third of a
        // JND.
        assert!(mean.abs() < 0.1, "{mean} JND²");
        let (a, b) = (surface(25_000, 1, 90.0), surface(25_000, 2, 90.0));
        assert!(score(&a, &b).level_error_jnd.unwrap() < 0.3);
    }

    #[test]
    fn six_decibels_are_two_and_a_half_to_three_jnd_and_another_surface_is_more() {
        let a = surface(50_000, 1, 90.0);
        let soft: Vec<f64> = surface(50_000, 2, 90.0).iter().map(|x| 0.5 * x).collect();
        let softer = score(&a, &soft).level_error_jnd.unwrap();
        assert!((2.5..3.0).contains(&softer), "{softer}");
        let other = score(&a, &surface(50_000, 3, 400.0));
        assert!(other.level_error_jnd.unwrap() > 2.0 * softer, "{other:?}");
    }

    #[test]
    fn the_balance_falls_when_high_frequencies_are_added_and_ignores_the_level() {
        let low = surface(50_000, 1, 50.0);
        let high = surface(50_000, 2, 400.0);
        let rms = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>().sqrt();
        let gain = 2.0 * rms(&low) / rms(&high);
        let bright: Vec<f64> = low.iter().zip(&high).map(|(a, b)| a + gain * b).collect();
        let scaled: Vec<f64> = low.iter().map(|x| 3.0 * x).collect();
        assert!(score(&low, &bright).balance_error_db.unwrap() < -5.0);
        assert!(score(&low, &scaled).balance_error_db.unwrap().abs() < 1e-9);
    }

    #[test]
    fn nothing_outside_the_range_counts() {
        let range = ScoringRange::of(1000.0, 2500).unwrap();
        let a = surface(50_000, 1, 90.0);
        let added: Vec<f64> = a
            .iter()
            .enumerate()
            .map(|(n, x)| x + 30.0 * (TAU * 700.0 * n as f64 / RATE_HZ).sin())
            .collect();
        let perceived = Perceived::of(&spectrum(&a, &range), &spectrum(&added, &range), &range);
        assert!(perceived.level_error_jnd.unwrap() < 0.2, "{perceived:?}");
        assert!(perceived.balance_error_db.unwrap().abs() < 0.1);
    }

    #[test]
    fn a_range_ends_below_half_of_the_recordings_own_rate() {
        let range = |rate_hz| ScoringRange::of(rate_hz, 5000).unwrap();
        assert_eq!(range(1000.0).high_hz, 450.0);
        assert_eq!(range(1000.0).cost_hz.1, 450.0);
        assert_eq!(range(1000.0).distance_hz(), (30.0, 450.0));
        for rate_hz in [5000.0, 44_100.0] {
            near(range(rate_hz).high_hz, 1122.0, 0.1);
            assert_eq!(range(rate_hz).cost_hz.1, 2500.0);
            assert_eq!(range(rate_hz).distance_hz(), DISTANCE_RANGE_HZ);
        }
        assert_eq!(ScoringRange::of(40.0, 5000), None);
    }

    #[test]
    fn a_range_begins_where_blocks_resolve_a_third_octave() {
        let low_hz = |block| ScoringRange::of(5000.0, block).map(|range| range.low_hz);
        assert_eq!(low_hz(2500), low_hz(5000));
        near(low_hz(1000).unwrap(), 38.6, 0.1);
        assert_eq!(low_hz(1), None);
        assert_eq!(low_hz(0), None);
    }
}
