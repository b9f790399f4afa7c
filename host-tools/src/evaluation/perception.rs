//! Scores in terms of what skin tells apart: the level in third octaves, the balance of low and high, impulsiveness,
//! and the flutter of the envelope.
//!
//! These are functions of two signals and know nothing of models. Nothing here is used by a fit: of `dsp` there is
//! Welch's spectrum and a Fourier transform. Signals come in blocks of equal length, at `rate_hz`, with a mean near
//! zero, and only the frequencies of a [`ScoringRange`] count.
//!
//! | score | definition |
//! |---|---|
//! | level error, JND | √(max(0, mean over third octaves b of (e_b² - s_b²))) / 2.2 dB |
//! | balance, dB | 10 log10 of the power below 100 Hz over that above |
//! | kurtosis | mean x⁴ / (mean x²)² of the signal in the range; 3 for Gaussian noise |
//! | modulation | RMS of the envelope's part from 8 to 64 Hz over the envelope's mean |
//!
//! e_b is the level of the second signal over the first, dB. s_b² is the variance that e_b has between two estimates of
//! one Gaussian noise, (10/ln 10)² (ψ′(n₁) + ψ′(n₂)) for means of n squares each, so that another seed of the same
//! noise scores 0 on average. A gain of -6 dB scores 2.7.
//!
//! Sources. JND of level 2.2 to 2.5 dB: Israr 2006. Energy per critical band predicts the realism of textures: arXiv
//! 2605.23804. Balance of low and high as the main cue: Bernard 2023. Kurtosis and the envelope tell apart impulses and
//! changes of level that a power spectrum does not show; no JND of theirs is known for textures, so they are given as
//! they are.

use serde::Serialize;

use crate::dsp::analytic::Analytic;
use crate::dsp::spectrum::{
    AMPLITUDE_JND_DB, BAND_COUNT, PowerSpectrum, band_edges_hz, band_errors_within_db,
};
use crate::evaluation::scoring_range::ScoringRange;

/// The frequency that divides low from high, Hz: below it skin follows single cycles, above it feels a tone or noise.
pub const LOW_HIGH_HZ: f64 = 100.0;

/// Range of the envelope's frequencies that count as modulation, Hz.
pub const MODULATION_HZ: (f64, f64) = (8.0, 64.0);

/// Shortest segment that resolves the lowest modulation, s: two periods of it.
const MODULATION_SEGMENT_S: f64 = 2.0 / MODULATION_HZ.0;

/// Properties of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Properties {
    /// Power spectral density.
    pub spectrum: PowerSpectrum,
    /// Power below 100 Hz over that above, dB; none if the range does not hold both, or one has no power.
    pub balance_db: Option<f64>,
    /// Kurtosis; none for silence.
    pub kurtosis: Option<f64>,
    /// Modulation of the envelope, as a share of its mean; none for silence, and for blocks that do not resolve 8 Hz.
    pub modulation: Option<f64>,
}

/// A signal against a reference, in what is felt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Perceived {
    /// Level error in third octaves, in JND.
    pub level_error_jnd: Option<f64>,
    /// The square of the level error before a negative value becomes 0: what is averaged over trials, JND².
    pub level_error_squared_jnd: Option<f64>,
    /// Balance of low and high over the reference's, dB.
    pub balance_error_db: Option<f64>,
    /// Kurtosis of the signal.
    pub kurtosis: Option<f64>,
    /// Modulation of the signal's envelope, as a share of its mean.
    pub modulation: Option<f64>,
}

impl Properties {
    /// Returns the properties of a signal in blocks, within `range`.
    pub fn of(blocks: &[&[f64]], rate_hz: f64, range: &ScoringRange) -> Self {
        let spectrum = PowerSpectrum::of_blocks(blocks, range.segment, rate_hz);
        let limited: Vec<Analytic> = blocks
            .iter()
            .map(|block| Analytic::of(block, rate_hz, range.low_hz, range.high_hz))
            .collect();
        Self {
            balance_db: balance_db(&spectrum, range),
            kurtosis: kurtosis(limited.iter().flat_map(|block| &block.signal)),
            modulation: modulation(&limited, rate_hz, range.segment),
            spectrum,
        }
    }
}

impl Perceived {
    /// Compares a signal's properties with those of its reference.
    pub fn of(reference: &Properties, signal: &Properties, range: &ScoringRange) -> Self {
        let squared = level_error_squared_jnd(&reference.spectrum, &signal.spectrum, range);
        Self {
            level_error_jnd: squared.map(|square| square.max(0.0).sqrt()),
            level_error_squared_jnd: squared,
            balance_error_db: signal
                .balance_db
                .zip(reference.balance_db)
                .map(|(signal, reference)| signal - reference),
            kurtosis: signal.kurtosis,
            modulation: signal.modulation,
        }
    }
}

/// Returns the mean square of the level error in third octaves, in JND², less what two estimates of one Gaussian noise
/// differ by. It is 0 on average for another take of the same noise, and may be negative.
///
/// `None` if the range holds no third octave, or a band has no power.
pub fn level_error_squared_jnd(
    reference: &PowerSpectrum,
    other: &PowerSpectrum,
    range: &ScoringRange,
) -> Option<f64> {
    let errors = band_errors_within_db(reference, other, range.band_edges_hz());
    let (mut sum, mut count) = (0.0, 0);
    for (band, error_db) in errors.iter().enumerate().take(BAND_COUNT) {
        let (low, high) = band_edges_hz(band);
        if !range.holds(low, high) {
            continue;
        }
        let error_db = (*error_db)?;
        let scatter = |spectrum: &PowerSpectrum| {
            (10.0 / std::f64::consts::LN_10).powi(2)
                * trigamma(spectrum.averages_between(low, high))
        };
        sum += error_db.powi(2) - scatter(reference) - scatter(other);
        count += 1;
    }
    let mean = sum / f64::from(count) / AMPLITUDE_JND_DB.powi(2);
    Some(mean).filter(|mean| mean.is_finite())
}

/// Trigamma function ψ′ above zero: recurrence up to 6, then the asymptotic series (Abramowitz and Stegun 6.4.12). The
/// logarithm of a mean of squares of 2x Gaussian numbers has this variance.
fn trigamma(mut x: f64) -> f64 {
    let mut sum = 0.0;
    while x < 6.0 {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    sum + 1.0 / x + 1.0 / (2.0 * x * x) + 1.0 / (6.0 * x.powi(3)) - 1.0 / (30.0 * x.powi(5))
}

/// Returns the power below [`LOW_HIGH_HZ`] over that above, within `range`, dB.
pub fn balance_db(spectrum: &PowerSpectrum, range: &ScoringRange) -> Option<f64> {
    let low = spectrum.power_between(range.low_hz, LOW_HIGH_HZ.min(range.high_hz));
    let high = spectrum.power_between(LOW_HIGH_HZ.max(range.low_hz), range.high_hz);
    Some(10.0 * (low / high).log10()).filter(|balance| balance.is_finite())
}

/// Returns mean x⁴ / (mean x²)²; `None` for silence.
pub fn kurtosis<'a>(signal: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (mut count, mut square, mut fourth) = (0.0, 0.0, 0.0);
    for x in signal {
        count += 1.0;
        square += x * x;
        fourth += x * x * x * x;
    }
    Some(fourth * count / (square * square)).filter(|kurtosis| kurtosis.is_finite())
}

/// Returns the RMS of the envelopes' part within [`MODULATION_HZ`] over their mean; `None` for silence, and where a
/// segment of so many samples does not resolve it.
fn modulation(blocks: &[Analytic], rate_hz: f64, segment: usize) -> Option<f64> {
    if (segment as f64) < MODULATION_SEGMENT_S * rate_hz {
        return None;
    }
    let mut envelopes: Vec<Vec<f64>> = blocks.iter().map(Analytic::envelope).collect();
    let count: usize = envelopes.iter().map(Vec::len).sum();
    let mean = envelopes.iter().flatten().sum::<f64>() / count as f64;
    envelopes
        .iter_mut()
        .flatten()
        .for_each(|value| *value -= mean);
    let envelopes: Vec<&[f64]> = envelopes.iter().map(Vec::as_slice).collect();
    let (low_hz, high_hz) = MODULATION_HZ;
    let power =
        PowerSpectrum::of_blocks(&envelopes, segment, rate_hz).power_between(low_hz, high_hz);
    Some(power.sqrt() / mean).filter(|share| share.is_finite())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const RATE_HZ: f64 = 5000.0;

    fn noise(len: usize, seed: u64) -> Vec<f64> {
        let generator = rand_pcg::Pcg64::seed_from_u64(seed);
        StandardNormal.sample_iter(generator).take(len).collect()
    }

    /// Noise through one resonance at `frequency_hz`.
    fn surface(len: usize, seed: u64, frequency_hz: f64) -> Vec<f64> {
        let (radius, angle) = (0.97f64, TAU * frequency_hz / RATE_HZ);
        let mut past = (0.0, 0.0);
        noise(len + 1000, seed)
            .into_iter()
            .map(|e| {
                let y = e + 2.0 * radius * angle.cos() * past.0 - radius * radius * past.1;
                past = (y, past.0);
                y
            })
            .skip(1000)
            .collect()
    }

    fn blocks(signal: &[f64]) -> Vec<&[f64]> {
        signal.chunks_exact(2500).collect()
    }

    fn range() -> ScoringRange {
        ScoringRange::of(RATE_HZ, 2500).unwrap()
    }

    fn properties(signal: &[f64]) -> Properties {
        Properties::of(&blocks(signal), RATE_HZ, &range())
    }

    fn score(reference: &[f64], signal: &[f64]) -> Perceived {
        Perceived::of(&properties(reference), &properties(signal), &range())
    }

    #[test]
    fn trigamma_has_its_known_values() {
        let pi = std::f64::consts::PI;
        for (x, value) in [
            (1.0, pi * pi / 6.0),
            (0.5, pi * pi / 2.0),
            (10.0, 0.105_166_335_7),
        ] {
            assert!((trigamma(x) - value).abs() < 1e-6, "{x}: {}", trigamma(x));
        }
    }

    /// One second against ten, as a recording's judged blocks against a synthesis.
    #[test]
    fn another_seed_of_one_surface_scores_about_nothing() {
        let pairs = 60;
        let mut mean = 0.0;
        for seed in 0..pairs {
            let (a, b) = (
                surface(5000, 2 * seed, 90.0),
                surface(50_000, 2 * seed + 1, 90.0),
            );
            mean += score(&a, &b).level_error_squared_jnd.unwrap() / pairs as f64;
        }
        // Levels of few averages are not quite as they would be if they were all alike; a tenth of a squared JND is
        // less than a third of a JND.
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
    fn kurtosis_tells_impulses_from_noise_of_the_same_spectrum() {
        let noise = noise(100_000, 1);
        let plain = properties(&noise).kurtosis.unwrap();
        assert!((plain - 3.0).abs() < 0.15, "{plain}");
        // Two samples in a hundred, of the same power in all.
        let impulses: Vec<f64> = noise
            .iter()
            .enumerate()
            .map(|(n, x)| if n % 50 == 0 { x * 50f64.sqrt() } else { 0.0 })
            .collect();
        assert!(properties(&impulses).kurtosis.unwrap() > 10.0);
        assert_eq!(properties(&vec![0.0; 5000]).kurtosis, None);
    }

    /// A carrier whose amplitude is 1 + m sin: the RMS of the envelope's swing is m/√2 of its mean.
    #[test]
    fn the_modulation_of_a_modulated_tone_is_what_it_was_modulated_by() {
        let tone = |depth: f64, frequency_hz: f64| -> Vec<f64> {
            let angle = |hz: f64, n: usize| TAU * hz * n as f64 / RATE_HZ;
            (0..10_000)
                .map(|n| (1.0 + depth * angle(frequency_hz, n).sin()) * angle(300.0, n).sin())
                .collect()
        };
        let modulated = properties(&tone(0.5, 20.0)).modulation.unwrap();
        assert!((modulated - 0.5 / 2f64.sqrt()).abs() < 0.01, "{modulated}");
        assert!(properties(&tone(0.0, 20.0)).modulation.unwrap() < 1e-3);
        // Slower and faster changes are not counted.
        assert!(properties(&tone(0.5, 2.0)).modulation.unwrap() < 0.05);
        assert!(properties(&tone(0.5, 150.0)).modulation.unwrap() < 0.02);
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
        let of = |signal: &[f64]| Properties::of(&blocks(signal), RATE_HZ, &range);
        let (plain, added) = (of(&a), of(&added));
        let perceived = Perceived::of(&plain, &added, &range);
        assert!(perceived.level_error_jnd.unwrap() < 0.2, "{perceived:?}");
        assert!(perceived.balance_error_db.unwrap().abs() < 0.1);
        assert!((added.kurtosis.unwrap() - plain.kurtosis.unwrap()).abs() < 0.01);
    }
}
